// Reads what the package writes of KTX 2.0: arrays of one channel, not compressed; level 0 alone.

/** @typedef {import('./types.js').TextureArray} TextureArray */

const IDENTIFIER = [0xab, 0x4b, 0x54, 0x58, 0x20, 0x32, 0x30, 0xbb, 0x0d, 0x0a, 0x1a, 0x0a];
const LEVELS_AT = 80;

/** By the number that Vulkan gives a format.
 * @type {Record<number, {name: TextureArray['format'], of: typeof Int8Array | typeof Uint16Array | typeof Uint32Array}>} */
const FORMATS = {
  10: { name: 'R8_SNORM', of: Int8Array },
  74: { name: 'R16_UINT', of: Uint16Array },
  98: { name: 'R32_UINT', of: Uint32Array },
};

/**
 * Level 0, as a view of the bytes where they lie well.
 * @param {ArrayBuffer} bytes of a file
 * @returns {TextureArray}
 * @throws {Error} that says what is wrong, without the name of the file
 */
export function readKtx2(bytes) {
  if (bytes.byteLength < LEVELS_AT + 24 || !isKtx2(bytes)) throw new Error('no KTX 2.0 file');
  const head = new DataView(bytes);
  const [kind, , width, height, depth, layers, faces, , scheme] = Array.from({ length: 9 }, (_, i) =>
    head.getUint32(12 + 4 * i, true),
  );
  const format = FORMATS[kind];
  if (!format) throw new Error(`format ${kind} is not one of a skin package`);
  if (scheme !== 0) throw new Error(`supercompression ${scheme} is not read`);
  if (depth !== 0 || faces !== 1 || layers === 0) throw new Error('is no array of 2D textures');
  const start = Number(head.getBigUint64(LEVELS_AT, true));
  const length = Number(head.getBigUint64(LEVELS_AT + 8, true));
  const count = width * height * layers;
  if (length !== count * format.of.BYTES_PER_ELEMENT || start + length > bytes.byteLength)
    throw new Error('is cut short, or its sizes contradict each other');
  const texels =
    start % format.of.BYTES_PER_ELEMENT === 0
      ? new format.of(bytes, start, count)
      : new format.of(bytes.slice(start, start + length));
  return { format: format.name, width, height, layers, texels };
}

/** @param {ArrayBuffer} bytes */
function isKtx2(bytes) {
  const first = new Uint8Array(bytes, 0, IDENTIFIER.length);
  return IDENTIFIER.every((value, i) => first[i] === value);
}
