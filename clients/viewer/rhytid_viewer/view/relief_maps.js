// Slopes of the whole skin in one pose, drawn cell by cell as they come into view.

import { Heights } from './heights.js';
import { Slopes } from './relief.js';

/** @typedef {import('./types.js').TileAddress} TileAddress */
/** @typedef {{target: import('./gl.js').Target, stale: Uint8Array}} CellMap stale: 1 of cells that are to be drawn */

const CELL = 256; // texels a side
const MARGIN = 2; // that slopes read around a cell

export class ReliefMaps {
  /**
   * @param {Heights} heights
   * @param {Slopes} slopes
   * @param {number} resolution
   */
  constructor(heights, slopes, resolution) {
    this._heights = heights;
    this._slopes = slopes;
    this._resolution = resolution;
    /** Texels a side of a cell. */
    this.cell = Math.min(CELL, resolution);
    this._across = resolution / this.cell;
    /** @type {Map<number, CellMap>} */
    this._maps = new Map();
  }

  /** Heights and slopes, and the products of slopes, of a UDIM that was drawn. @param {number} udim */
  textures(udim) {
    const target = this._maps.get(udim)?.target;
    return target && { relief: target.texture, moments: target.beside[0] };
  }

  /**
   * Moments of slopes of a whole UDIM, as `Slopes.read` has them.
   * @param {number} udim @param {number} level @param {Float32Array} stretch of the pose
   */
  moments(udim, level, stretch) {
    const cells = Array.from({ length: this._across ** 2 }, (_, at) => at);
    const { target } = this._of(udim);
    this.draw(cells.map((at) => ({ udim, level: 0, row: Math.floor(at / this._across), column: at % this._across })), stretch);
    return this._slopes.read(target, level);
  }

  /** The pose is another one. */
  forget() {
    for (const { stale } of this._maps.values()) stale.fill(1);
  }

  /** Whether there may be something to draw. @param {number[]} udims */
  stale(udims) {
    return udims.some((udim) => this._of(udim).stale.includes(1));
  }

  /**
   * Draw what is not there yet.
   * @param {TileAddress[]} cells that are in view
   * @param {Float32Array} stretch of the pose
   */
  draw(cells, stretch) {
    /** @type {Map<number, TileAddress[]>} */
    const wanted = new Map();
    for (const cell of cells) {
      const { stale } = this._of(cell.udim), at = cell.row * this._across + cell.column;
      if (!stale[at]) continue;
      stale[at] = 0;
      wanted.set(cell.udim, [...(wanted.get(cell.udim) ?? []), cell]);
    }
    if (wanted.size > 0) this._heights.begin(stretch);
    for (const [udim, those] of wanted) {
      const heights = this._heights.draw(udim, those.map((cell) => this._part(cell, MARGIN)));
      const { target } = this._of(udim);
      this._slopes.draw(target, heights, this._heights.triangles(udim), those.map((cell) => this._part(cell, 0)));
    }
  }

  /** @param {number} udim */
  _of(udim) {
    let found = this._maps.get(udim);
    if (!found) {
      found = { target: this._slopes.room(this._resolution, true), stale: new Uint8Array(this._across ** 2).fill(1) };
      this._maps.set(udim, found);
    }
    return found;
  }

  /** Column, row, columns and rows. @param {TileAddress} cell @param {number} margin */
  _part({ row, column }, margin) {
    const held = (/** @type {number} */ at) => Math.max(0, Math.min(this._resolution, at));
    const [x, y] = [held(column * this.cell - margin), held(row * this.cell - margin)];
    const [right, bottom] = [held((column + 1) * this.cell + margin), held((row + 1) * this.cell + margin)];
    return [x, y, right - x, bottom - y];
  }
}
