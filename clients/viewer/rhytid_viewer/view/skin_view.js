// A face with its skin on a canvas.

import { Camera } from './camera.js';

/** @typedef {import('./types.js').ViewOptions} ViewOptions */
/** @typedef {import('./types.js').TileAddress} TileAddress */

/** The browser or its graphics lack what is needed; the message says what. */
export class Unsupported extends Error {}

export class SkinView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import('./types.js').SkinPackage} skinPackage
   * @throws {Unsupported} where WebGL2 or float targets are missing
   */
  constructor(canvas, skinPackage) {
    this.canvas = canvas;
    this.skinPackage = skinPackage;
    /** Looks at the whole mesh at first. */
    this.camera = new Camera();
  }

  /** Colours of the stretch, from the least to the most. @returns {import('./types.js').LegendEntry[]} */
  static legend() {
    return [];
  }

  /**
   * Pose the mesh.
   * @param {ArrayLike<number>} weights one of every shape
   */
  setWeights(weights) {
    void weights;
  }

  /** @param {Partial<ViewOptions>} options those that change */
  setOptions(options) {
    void options;
  }

  /**
   * A tile of the service for the pose that is set. A new pose forgets all tiles.
   * @param {TileAddress} address
   * @param {number} size texels a side
   * @param {Float32Array | null} heights mesh units, row by row; null forgets the tile
   */
  setExactTile(address, size, heights) {
    void [address, size, heights];
  }

  /**
   * What has to be asked for to fill the picture, at the level whose texels are about a pixel.
   * @returns {{level: number, tiles: TileAddress[]}}
   */
  tilesInView() {
    return { level: 0, tiles: [] };
  }

  /** Of the posed mesh, x, y, z in the original order of vertices, with the centre: what a service
   * takes as a frame. @returns {Float32Array} */
  positions() {
    return new Float32Array(0);
  }

  /** Draw a frame. The size of the canvas in pixels is the caller's. */
  draw() {}

  /**
   * What lies at a place of the picture.
   * @param {number} x CSS pixels from the left of the canvas
   * @param {number} y CSS pixels from its top
   * @returns {import('./types.js').Probe | null} null beside the mesh
   */
  probe(x, y) {
    void [x, y];
    return null;
  }

  /** The picture as PNG. @returns {Promise<Blob>} */
  async picture() {
    return new Blob();
  }

  /** @returns {import('./types.js').Statistics} */
  statistics() {
    return { textureBytes: 0, stretchMilliseconds: 0, frameMilliseconds: 0 };
  }

  /** Free everything on the GPU. */
  dispose() {}
}
