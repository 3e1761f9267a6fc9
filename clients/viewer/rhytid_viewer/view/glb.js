// Reads skin.glb of a package: one mesh with morph targets.

/** @typedef {import('./types.js').PackageMesh} PackageMesh */

const MAGIC = 0x46546c67;
const FLOAT = 5126;
/** @type {Map<number, typeof Uint16Array | typeof Uint32Array>} */
const INTEGERS = new Map();
INTEGERS.set(5123, Uint16Array).set(5125, Uint32Array);
/** @type {Record<string, number>} */
const NUMBERS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/**
 * The mesh, without the scale of its node.
 * @param {ArrayBuffer} bytes of a file
 * @returns {PackageMesh}
 * @throws {Error} that says what is wrong, without the name of the file
 */
export function readGlb(bytes) {
  const { document, binary } = chunks(bytes);
  const primitive = document.meshes?.[0]?.primitives?.[0];
  if (!primitive) throw new Error('has no mesh');
  /** @param {number | undefined} index @param {string} name */
  const read = (index, name) => accessor(document, binary, index, name);
  const attributes = primitive.attributes ?? {};
  const positions = floats(read(attributes.POSITION, 'POSITION'), 'POSITION');
  const indices = read(primitive.indices, 'indices');
  const targets = primitive.targets ?? [];
  const names = document.meshes[0].extras?.targetNames ?? [];
  const mesh = {
    positions,
    indices: Uint32Array.from(indices),
    uvs: floats(read(attributes.TEXCOORD_0, 'TEXCOORD_0'), 'TEXCOORD_0'),
    vertex: Uint32Array.from(read(attributes._VERTEX, '_VERTEX')),
    shapes: targets.map((/** @type {{POSITION?: number}} */ target, /** @type {number} */ i) => ({
      name: String(names[i] ?? i),
      offsets: floats(read(target.POSITION, `target ${i}`), `target ${i}`),
    })),
  };
  check(mesh);
  return mesh;
}

/** @param {ArrayBuffer} bytes */
function chunks(bytes) {
  const view = new DataView(bytes);
  if (bytes.byteLength < 20 || view.getUint32(0, true) !== MAGIC) throw new Error('no GLB file');
  const length = view.getUint32(12, true);
  const after = 20 + length;
  if (after + 8 > bytes.byteLength) throw new Error('is cut short');
  const size = view.getUint32(after, true);
  if (after + 8 + size > bytes.byteLength) throw new Error('is cut short');
  const text = new TextDecoder().decode(new Uint8Array(bytes, 20, length));
  return { document: JSON.parse(text), binary: bytes.slice(after + 8, after + 8 + size) };
}

/**
 * @param {any} document
 * @param {ArrayBuffer} binary
 * @param {number | undefined} index
 * @param {string} name
 */
function accessor(document, binary, index, name) {
  const found = index === undefined ? undefined : document.accessors?.[index];
  if (!found) throw new Error(`has no ${name}`);
  const part = document.bufferViews[found.bufferView];
  const kind = found.componentType === FLOAT ? Float32Array : INTEGERS.get(found.componentType);
  if (!kind || part.byteStride || found.sparse) throw new Error(`${name} has a layout that is not read`);
  const start = (part.byteOffset ?? 0) + (found.byteOffset ?? 0);
  const count = found.count * NUMBERS[found.type];
  if (start + count * kind.BYTES_PER_ELEMENT > binary.byteLength) throw new Error(`${name} is cut short`);
  return new kind(binary, start, count);
}

/** @param {Float32Array | Uint16Array | Uint32Array} values @param {string} name */
function floats(values, name) {
  if (!(values instanceof Float32Array)) throw new Error(`${name} is not of floats`);
  return values;
}

/** @param {PackageMesh} mesh */
function check(mesh) {
  const count = mesh.positions.length / 3;
  if (mesh.uvs.length !== 2 * count || mesh.vertex.length !== count)
    throw new Error('has not as many texture coordinates or _VERTEX as positions');
  for (const shape of mesh.shapes)
    if (shape.offsets.length !== 3 * count) throw new Error(`shape ${shape.name} has another number of vertices`);
  for (const index of mesh.indices) if (index >= count) throw new Error(`index ${index} is beyond the vertices`);
}
