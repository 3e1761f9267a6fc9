// A camera that turns around a point.

/** @typedef {import('./types.js').Vector} Vector */

export class Camera {
  constructor() {
    /** @type {Vector} what it looks at, in the axes of the mesh less its centre */
    this.target = [0, 0, 0];
    /** From the target, mesh units. */
    this.distance = 1;
    /** Around the y axis, radians; 0 looks along -z. */
    this.yaw = 0;
    /** Above the horizon, radians. */
    this.pitch = 0;
    /** Of the height of the picture, radians. */
    this.fov = 0.45;
  }

  /**
   * Turn by a drag.
   * @param {number} dx CSS pixels
   * @param {number} dy CSS pixels, down
   */
  orbit(dx, dy) {
    void [dx, dy];
  }

  /**
   * Move by a drag, so that the target stays under the pointer.
   * @param {number} dx CSS pixels
   * @param {number} dy CSS pixels, down
   */
  pan(dx, dy) {
    void [dx, dy];
  }

  /**
   * Come closer to what lies at a place of the picture.
   * @param {number} factor of the distance; below 1 comes closer
   * @param {number} [x] CSS pixels from the left of the canvas; without x and y the middle
   * @param {number} [y] CSS pixels from its top
   */
  zoom(factor, x, y) {
    void [factor, x, y];
  }
}
