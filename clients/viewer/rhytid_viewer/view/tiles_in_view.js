// Which tiles of a map fill the picture, and at which level.

import { origin } from './mesh_textures.js';

/** @typedef {import('./types.js').TileAddress} TileAddress */
/** @typedef {{positions: Float32Array, indices: Uint32Array, uvs: Float32Array, udims: number[][]}} Posed udims: of every triangle */
/** @typedef {{resolution: number, tile: number}} Grid texels a side of a map and of a tile */
/** @typedef {{triangle: number, texels: number, pixels: number, middle: number}} Seen areas, and how
 *   far from the middle of the picture */

const LEAST = 1e-6; // pixels

/**
 * Tiles of the triangles that face the eye, those in the middle of the picture first.
 * @param {Posed} posed
 * @param {Grid} grid
 * @param {Float32Array} matrix to the clip space
 * @param {number} width of the picture, pixels
 * @param {number} height
 * @returns {{level: number, tiles: TileAddress[]}}
 */
export function tilesInView(posed, grid, matrix, width, height) {
  const seen = seenTriangles(posed, grid, matrix, width, height);
  const level = levelOf(seen, grid);
  return { level, tiles: tilesOfLevel(posed, grid, seen, level) };
}

/**
 * The same of level 0, whatever is needed.
 * @param {Posed} posed
 * @param {Grid} grid
 * @param {Float32Array} matrix to the clip space
 * @param {number} width of the picture, pixels
 * @param {number} height
 */
export function finestTilesInView(posed, grid, matrix, width, height) {
  return tilesOfLevel(posed, grid, seenTriangles(posed, grid, matrix, width, height), 0);
}

/** @param {Posed} posed @param {Grid} grid @param {Seen[]} seen @param {number} level @returns {TileAddress[]} */
function tilesOfLevel(posed, grid, seen, level) {
  const side = grid.resolution >> level, tile = Math.min(grid.tile, side);
  /** @type {Map<string, {address: TileAddress, middle: number}>} */
  const found = new Map();
  for (const { triangle, middle } of seen)
    for (const address of tilesOf(posed, triangle, level, side, tile)) {
      const name = `${address.udim}/${address.row}/${address.column}`;
      const before = found.get(name);
      if (!before || before.middle > middle) found.set(name, { address, middle });
    }
  return [...found.values()].sort((a, b) => a.middle - b.middle).map(({ address }) => address);
}

/**
 * @param {Posed} posed @param {Grid} grid @param {Float32Array} matrix
 * @param {number} width @param {number} height
 */
function seenTriangles({ positions, indices, uvs }, grid, matrix, width, height) {
  const count = positions.length / 3, screen = new Float64Array(3 * count);
  for (let i = 0; i < count; i++) project(matrix, positions, i, screen);
  /** @type {Seen[]} */
  const seen = [];
  for (let t = 0; t < indices.length; t += 3) {
    const [a, b, c] = [indices[t], indices[t + 1], indices[t + 2]];
    const ahead = Number(screen[3 * a + 2] > 0) + Number(screen[3 * b + 2] > 0) + Number(screen[3 * c + 2] > 0);
    if (ahead === 0 || (ahead === 3 && !inPicture(screen, a, b, c))) continue;
    // Of one that reaches behind the eye nothing is known but that it may be seen.
    const pixels = ahead === 3 ? (cross2(screen, 3, a, b, c) * width * height) / 8 : LEAST;
    if (!(pixels > 0)) continue;
    const texels = (Math.abs(cross2(uvs, 2, a, b, c)) * grid.resolution ** 2) / 2;
    const x = (screen[3 * a] + screen[3 * b] + screen[3 * c]) / 3;
    const y = (screen[3 * a + 1] + screen[3 * b + 1] + screen[3 * c + 1]) / 3;
    seen.push({ triangle: t / 3, texels, pixels, middle: Math.hypot(x, y) });
  }
  return seen;
}

/** @param {Float32Array} m @param {Float32Array} p @param {number} i @param {Float64Array} out */
function project(m, p, i, out) {
  const x = p[3 * i], y = p[3 * i + 1], z = p[3 * i + 2];
  const w = m[3] * x + m[7] * y + m[11] * z + m[15];
  out[3 * i] = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w;
  out[3 * i + 1] = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
  out[3 * i + 2] = w;
}

/** @param {Float64Array} s @param {number} a @param {number} b @param {number} c */
function inPicture(s, a, b, c) {
  for (let axis = 0; axis < 2; axis++) {
    const [x, y, z] = [s[3 * a + axis], s[3 * b + axis], s[3 * c + axis]];
    if (Math.max(x, y, z) < -1 || Math.min(x, y, z) > 1) return false;
  }
  return true;
}

/** @param {Float64Array | Float32Array} s @param {number} size @param {number} a @param {number} b @param {number} c */
function cross2(s, size, a, b, c) {
  const x1 = s[size * b] - s[size * a], y1 = s[size * b + 1] - s[size * a + 1];
  const x2 = s[size * c] - s[size * a], y2 = s[size * c + 1] - s[size * a + 1];
  return x1 * y2 - x2 * y1;
}

/** The level whose texels are about a pixel in half of the picture. @param {Seen[]} seen @param {Grid} grid */
function levelOf(seen, grid) {
  const sorted = seen.map(({ texels, pixels }) => ({ pixels, level: Math.log2(texels / pixels) / 2 }));
  sorted.sort((a, b) => a.level - b.level);
  const half = sorted.reduce((sum, { pixels }) => sum + pixels, 0) / 2;
  let sum = 0;
  const middle = sorted.find(({ pixels }) => (sum += pixels) >= half);
  return Math.max(0, Math.min(Math.log2(grid.resolution), Math.round(middle?.level ?? 0)));
}

/**
 * Those that the box of a triangle in UV touches.
 * @param {Posed} posed @param {number} triangle @param {number} level
 * @param {number} side of the map @param {number} tile texels a side, both of the level
 */
function* tilesOf({ indices, uvs, udims }, triangle, level, side, tile) {
  const corners = [0, 1, 2].map((corner) => indices[3 * triangle + corner]);
  const count = side / tile;
  /** @param {number[]} places */
  const span = (places) => {
    /** @param {number} at */
    const held = (at) => Math.max(0, Math.min(count - 1, Math.floor(at * count)));
    return [held(Math.min(...places)), held(Math.max(...places))];
  };
  for (const udim of udims[triangle]) {
    const [column, row] = origin(udim);
    const columns = span(corners.map((i) => uvs[2 * i] - column)), rows = span(corners.map((i) => uvs[2 * i + 1] + row));
    for (let y = rows[0]; y <= rows[1]; y++)
      for (let x = columns[0]; x <= columns[1]; x++) yield { udim, level, row: y, column: x };
  }
}
