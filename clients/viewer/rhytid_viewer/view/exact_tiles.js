// Tiles of heights that come from outside, by UDIM and level, with their slopes.

import { Target, Textures } from './gl.js';
import { Slopes } from './relief.js';

/** @typedef {import('./types.js').TileAddress} TileAddress */
/** @typedef {{heights: WebGLTexture, present: WebGLTexture, slopes: Target, cell: number, cells: Uint8Array, stale: Set<number>}} Level stale: cells whose slopes are to be drawn */

const MARGIN = 2; // texels around a cell whose slopes read it

export class ExactTiles {
  /**
   * @param {Textures} textures
   * @param {Slopes} slopes
   * @param {number} resolution
   */
  constructor(textures, slopes, resolution) {
    this._textures = textures;
    this._slopes = slopes;
    this._resolution = resolution;
    /** @type {Map<string, Level>} by UDIM and level */
    this._levels = new Map();
  }

  /**
   * @param {TileAddress} address
   * @param {number} size texels a side
   * @param {Float32Array | null} heights null forgets the tile
   * @throws {Error} where the address or the size is none of the map
   */
  set(address, size, heights) {
    const { udim, level, row, column } = address, side = this._resolution >> level;
    const count = side / size;
    if (!Number.isInteger(count) || row < 0 || column < 0 || row >= count || column >= count)
      throw new Error(`tile ${udim}/${level}/${row}/${column} of ${size} texels is none of a map of ${side}`);
    if (heights && heights.length !== size * size)
      throw new Error(`tile ${udim}/${level}/${row}/${column} has ${heights.length} texels, not ${size * size}`);
    const found = this._level(udim, level, side, size);
    found.cells[row * count + column] = heights ? 1 : 0;
    if (heights)
      this._textures.write(found.heights, 'R32F', column * size, row * size, size, size, heights);
    this._textures.write(found.present, 'R8_UINT', 0, 0, count, count, found.cells);
    found.stale.add(row * count + column);
  }

  /** Forget all tiles. The room for them stays. */
  clear() {
    for (const found of this._levels.values()) {
      if (!found.cells.some((there) => there)) continue;
      const count = Math.sqrt(found.cells.length);
      found.cells.forEach((there, at) => there && found.stale.add(at));
      this._textures.write(found.present, 'R8_UINT', 0, 0, count, count, found.cells.fill(0));
    }
  }

  /** Forget all tiles and give their memory back. */
  free() {
    for (const { heights, present, slopes } of this._levels.values()) {
      slopes.remove();
      for (const texture of [heights, present, slopes.texture]) this._textures.remove(texture);
    }
    this._levels.clear();
  }

  /**
   * What to draw a UDIM with: of the levels that have tiles the nearest to the one wanted, rather
   * finer; null where there is none.
   * @param {number} udim
   * @param {number} wanted level
   */
  of(udim, wanted) {
    const levels = Array.from({ length: Math.log2(this._resolution) + 1 }, (_, level) => level);
    levels.sort((a, b) => Math.abs(a - wanted) - Math.abs(b - wanted) || a - b);
    for (const level of levels) {
      const found = this._levels.get(`${udim}/${level}`);
      if (!found || !found.cells.some((there) => there)) continue;
      if (found.stale.size) this._slopes.drawTiles(found.slopes, found.heights, found.present, found.cell, partsOf(found));
      found.stale.clear();
      return { tiles: found.slopes.texture, present: found.present };
    }
    return null;
  }

  /** @param {number} udim @param {number} level @param {number} side @param {number} size @returns {Level} */
  _level(udim, level, side, size) {
    const name = `${udim}/${level}`;
    let found = this._levels.get(name);
    if (found && found.cell !== size) throw new Error(`tiles of level ${level} have ${found.cell} texels a side, not ${size}`);
    if (!found) {
      const count = side / size;
      found = {
        heights: this._textures.plain('R32F', side, side),
        present: this._textures.plain('R8_UINT', count, count),
        slopes: this._slopes.room(side),
        cell: size,
        cells: new Uint8Array(count * count),
        stale: new Set(),
      };
      this._levels.set(name, found);
    }
    return found;
  }
}

/** Column, row, columns and rows of what stale cells change. @param {Level} level */
function partsOf({ slopes, cell, stale }) {
  const across = slopes.width / cell;
  const held = (/** @type {number} */ at) => Math.max(0, Math.min(slopes.width, at));
  return [...stale].map((at) => {
    const [column, row] = [at % across, Math.floor(at / across)];
    const [x, y] = [held(column * cell - MARGIN), held(row * cell - MARGIN)];
    return [x, y, held((column + 1) * cell + MARGIN) - x, held((row + 1) * cell + MARGIN) - y];
  });
}
