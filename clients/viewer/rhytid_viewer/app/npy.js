// Arrays of numpy: .npy and .npz files.

/**
 * @typedef {object} NumpyArray
 * @property {number[]} shape
 * @property {Float32Array | Float64Array | string[] | number[]} values row by row
 */

/**
 * Read a .npy file of little-endian numbers or of text.
 * @param {ArrayBuffer} buffer
 * @returns {NumpyArray}
 * @throws {Error} that says what is wrong with it
 */
export function readNpy(buffer) {
  const bytes = new Uint8Array(buffer);
  if (String.fromCharCode(...bytes.subarray(1, 6)) !== "NUMPY") throw new Error("this is no .npy file");
  const view = new DataView(buffer);
  const wide = bytes[6] >= 2;
  const start = wide ? 12 : 10;
  const end = start + (wide ? view.getUint32(8, true) : view.getUint16(8, true));
  const header = new TextDecoder("latin1").decode(bytes.subarray(start, end));
  const type = /'descr':\s*'([^']+)'/.exec(header)?.[1] ?? "";
  const shape = [...(/'shape':\s*\(([^)]*)\)/.exec(header)?.[1] ?? "").matchAll(/\d+/g)].map(Number);
  if (/'fortran_order':\s*True/.test(header)) throw new Error("the array is in Fortran's order");
  const count = shape.reduce((product, length) => product * length, 1);
  return { shape, values: valuesOf(type, buffer.slice(end), count) };
}

/** @param {string} type @param {ArrayBuffer} body @param {number} count */
function valuesOf(type, body, count) {
  if (type === "<f4") return new Float32Array(body, 0, count);
  if (type === "<f8") return new Float64Array(body, 0, count);
  const text = /^<U(\d+)$/.exec(type);
  if (text) return texts(body, count, Number(text[1]));
  if (type === "<i4") return [...new Int32Array(body, 0, count)];
  if (type === "<i8") return [...new BigInt64Array(body, 0, count)].map(Number);
  throw new Error(`numbers of the type ${type || "?"} are not read here: float32 and float64 are`);
}

/** @param {ArrayBuffer} body @param {number} count @param {number} width */
function texts(body, count, width) {
  const codes = new Uint32Array(body, 0, count * width);
  return Array.from({ length: count }, (_, index) => {
    const own = codes.subarray(index * width, (index + 1) * width);
    return String.fromCodePoint(...own.filter((code) => code));
  });
}

/**
 * The members of a .npz file by their names; each is read when it is asked for.
 * @param {ArrayBuffer} buffer
 * @returns {Map<string, () => Promise<NumpyArray>>}
 * @throws {Error} where it is no zip
 */
export function openNpz(buffer) {
  const view = new DataView(buffer);
  let end = buffer.byteLength - 22;
  while (end >= 0 && view.getUint32(end, true) !== 0x06054b50) end -= 1;
  if (end < 0) throw new Error("this is no .npz file");
  const found = new Map();
  let at = view.getUint32(end + 16, true);
  for (let left = view.getUint16(end + 10, true); left > 0; left -= 1) {
    const [name, extra, comment] = [28, 30, 32].map((place) => view.getUint16(at + place, true));
    const method = view.getUint16(at + 10, true);
    const size = view.getUint32(at + 20, true);
    const local = view.getUint32(at + 42, true);
    const text = new TextDecoder().decode(new Uint8Array(buffer, at + 46, name));
    const body = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
    const packed = () => buffer.slice(body, body + size);
    found.set(text.replace(/\.npy$/, ""), async () => readNpy(method ? await inflated(packed()) : packed()));
    at += 46 + name + extra + comment;
  }
  return found;
}

/** @param {ArrayBuffer} packed */
async function inflated(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Response(stream).arrayBuffer();
}

/**
 * A .npy file of float32.
 * @param {Float32Array} values
 * @param {number[]} shape
 * @returns {Uint8Array<ArrayBuffer>}
 */
export function writeNpy(values, shape) {
  const said = `{'descr': '<f4', 'fortran_order': False, 'shape': (${shape.join(", ")},), }`;
  const header = `${said.padEnd(128 - 10 - 1)}\n`;
  const bytes = new Uint8Array(128 + values.byteLength);
  bytes.set([0x93, 0x4e, 0x55, 0x4d, 0x50, 0x59, 1, 0]);
  new DataView(bytes.buffer).setUint16(8, header.length, true);
  bytes.set(new TextEncoder().encode(header), 10);
  bytes.set(new Uint8Array(values.buffer, values.byteOffset, values.byteLength), 128);
  return bytes;
}
