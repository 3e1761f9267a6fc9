// Tiles of the service's `redraw` for what is in view.
//
// The posed positions go to the service as a frame, of a name for each pose; tiles are asked for one by
// one, a few at a time, so that what is outdated is cancelled at once, by a new pose or another view. A
// live connection would draw an outdated frame to its end.

import { readNpy, writeNpy } from "./npy.js";
import { reason } from "./messages.js";
import { Refused } from "./retry.js";

/**
 * @typedef {import('../view/types.js').TileAddress} TileAddress
 * @typedef {{wanted: number, shown: number, problem: string | null}} Progress wanted is 0 until it is
 *   known what is in view
 */

const AT_ONCE = 3;
// Milliseconds: nothing moves for so long; until a service that is busy is asked again.
const QUIET = 150;
const BUSY = 1500;
// Tiles out of view that are kept for when they come back.
const KEPT = 64;

export class ExactTiles {
  /**
   * @param {import('./service.js').Service} service
   * @param {string} asset
   * @param {import('../view/skin_view.js').SkinView} view
   * @param {(progress: Progress) => void} onProgress after every tile
   * @param {() => void} onFailure the service was not reached
   */
  constructor(service, asset, view, onProgress, onFailure) {
    this.service = service;
    this.view = view;
    this.onProgress = onProgress;
    this.onFailure = onFailure;
    this.frames = `v1/assets/${encodeURIComponent(asset)}/frames`;
    /** Of the pose that is set: no frame ever has the positions of two. */
    this.frame = this.newName();
    this.on = false;
    /** The sending of the frame, once it has begun. @type {Promise<unknown> | null} */
    this.sending = null;
    /** Whether the frame was sent again because the service had forgotten it. */
    this.resent = false;
    this.timer = 0;
    /** Of the pose that is set. @type {Map<string, {tile: TileAddress, size: number, heights: Float32Array}>} */
    this.tiles = new Map();
    this.aborting = new AbortController();
  }

  /** Ask for tiles from now on, or no more. @param {boolean} on */
  turn(on) {
    if (this.on === on) return;
    this.on = on;
    if (!on) {
      this.stop();
      return;
    }
    // The view has given their memory back.
    for (const { tile, size, heights } of this.tiles.values()) this.view.setExactTile(tile, size, heights);
    this.later();
  }

  /** Another pose is set, which the view has no tiles of. */
  posed() {
    this.forget();
    this.tiles.clear();
    this.stop();
    if (this.on) this.later();
  }

  /** Other tiles may be in view. */
  moved() {
    if (this.on) this.later();
  }

  /** The service answers again: it may know nothing of the frame. */
  again() {
    this.sending = null;
    if (this.on) this.later();
  }

  /** Forget the frame in the service: the page is left, or another face is shown. */
  dispose() {
    this.turn(false);
    this.forget();
  }

  /** Another frame from now on; the one before is deleted. */
  forget() {
    const { frame, sending } = this;
    this.frame = this.newName();
    this.sending = null;
    // A frame that is still on its way would be stored after it was deleted.
    sending?.catch(() => {}).then(() => this.remove(frame));
  }

  newName() {
    return `${this.frames}/viewer-${crypto.getRandomValues(new Uint32Array(2)).join("-")}`;
  }

  /** @param {string} frame */
  remove(frame) {
    const options = { method: "DELETE", keepalive: true, headers: this.service.headers() };
    fetch(this.service.url(frame), options).catch(() => {});
  }

  stop() {
    clearTimeout(this.timer);
    this.aborting.abort();
    this.aborting = new AbortController();
  }

  /** @param {number} [milliseconds] */
  later(milliseconds = QUIET) {
    clearTimeout(this.timer);
    if (milliseconds === QUIET) this.onProgress({ wanted: 0, shown: 0, problem: null });
    this.timer = window.setTimeout(() => this.refresh(), milliseconds);
  }

  /** Ask for what is in view and not there. */
  async refresh() {
    this.stop();
    const { signal } = this.aborting;
    const { tiles } = this.view.tilesInView();
    this.dropOthers(tiles);
    const missing = tiles.filter((tile) => !this.tiles.has(keyOf(tile)));
    const progress = { wanted: tiles.length, shown: tiles.length - missing.length, problem: null };
    this.onProgress(progress);
    try {
      if (missing.length) await this.sendFrame(signal);
      const ask = async () => {
        for (let tile = missing.shift(); tile && !signal.aborted; tile = missing.shift()) {
          await this.fetchTile(tile, signal);
          progress.shown += 1;
          this.onProgress(progress);
        }
      };
      await Promise.all(Array.from({ length: AT_ONCE }, ask));
    } catch (error) {
      if (!signal.aborted) this.failed(error, progress);
    }
  }

  /** @param {AbortSignal} signal */
  async sendFrame(signal) {
    // Not cancelled with the tiles: a service stores what it has begun to read.
    const sending = (this.sending ??= this.put());
    try {
      await sending;
    } catch (error) {
      if (this.sending === sending) this.sending = null;
      throw error;
    }
    signal.throwIfAborted();
  }

  put() {
    const positions = this.view.positions();
    const body = writeNpy(positions, [positions.length / 3, 3]);
    return this.service.call(this.frame, { method: "PUT", body, headers: { "Content-Type": "application/x-npy" } });
  }

  /** @param {TileAddress} tile @param {AbortSignal} signal */
  async fetchTile(tile, signal) {
    const path = `${this.frame}/tiles/${keyOf(tile)}?method=redraw&format=npy`;
    const answer = await this.service.call(path, { signal });
    const { shape, values } = readNpy(await answer.arrayBuffer());
    if (signal.aborted) return;
    this.resent = false;
    const [size, heights] = [shape[0], /** @type {Float32Array} */ (values)];
    this.tiles.set(keyOf(tile), { tile, size, heights });
    this.view.setExactTile(tile, size, heights);
  }

  /**
   * Displacement by the finest tile that is there.
   * @param {number} udim
   * @param {readonly [number, number]} texel column and row of level 0
   * @returns {{height: number, level: number} | null}
   */
  heightAt(udim, [column, row]) {
    const here = [...this.tiles.values()].filter(({ tile, size }) => {
      const at = [column >> tile.level, row >> tile.level].map((place) => Math.floor(place / size));
      return tile.udim === udim && at[0] === tile.column && at[1] === tile.row;
    });
    const [finest] = here.sort((a, b) => a.tile.level - b.tile.level);
    if (!this.on || !finest) return null;
    const { tile, size, heights } = finest;
    const [x, y] = [column, row].map((place) => (place >> tile.level) % size);
    return { height: heights[y * size + x], level: tile.level };
  }

  /** Forget tiles that are not in view, where there are many. @param {TileAddress[]} inView */
  dropOthers(inView) {
    const wanted = new Set(inView.map(keyOf));
    for (const [key, { tile, size }] of this.tiles) {
      if (this.tiles.size <= KEPT) return;
      if (wanted.has(key)) continue;
      this.tiles.delete(key);
      this.view.setExactTile(tile, size, null);
    }
  }

  /** @param {unknown} error @param {Progress} progress */
  failed(error, progress) {
    this.stop();
    if (error instanceof TypeError) {
      this.onProgress({ ...progress, problem: "the service does not answer" });
      this.onFailure();
    } else if (!(error instanceof Refused)) {
      this.onProgress({ ...progress, problem: reason(error) });
    } else if (error.status === 404 && this.sending && !this.resent) {
      // Who restarted knows no frame.
      this.resent = true;
      this.again();
    } else {
      this.onProgress({ ...progress, problem: error.message });
      if (error.status === 503 || error.status === 429) this.later(BUSY);
    }
  }
}

/** @param {TileAddress} tile @returns {string} as in the path of a tile */
export function keyOf({ udim, level, row, column }) {
  return `${udim}/${level}/${row}/${column}`;
}
