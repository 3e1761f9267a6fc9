// A camera that turns around a point.

import { add, cross, dot, lookMatrix, perspective, product, scaled, subtract } from './vectors.js';

/** @typedef {import('./types.js').Vector} Vector */

const TURN = 0.008; // radians a CSS pixel
const STEEPEST = 1.55;

export class Camera {
  /**
   * @param {() => {width: number, height: number}} [size] of the picture, CSS pixels
   * @param {(origin: Vector, direction: Vector) => Vector | null} [hit] where a ray meets the mesh
   */
  constructor(size = () => ({ width: 1, height: 1 }), hit = () => null) {
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
    /** Least and largest distance, mesh units. */
    this.range = [1e-6, 1e6];
    /** Of a ball around the middle of the mesh. */
    this.radius = 1;
    this._size = size;
    this._hit = hit;
  }

  /**
   * Turn by a drag.
   * @param {number} dx CSS pixels
   * @param {number} dy CSS pixels, down
   */
  orbit(dx, dy) {
    this.yaw -= TURN * dx;
    this.pitch = Math.max(-STEEPEST, Math.min(STEEPEST, this.pitch + TURN * dy));
  }

  /**
   * Move by a drag, so that the target stays under the pointer.
   * @param {number} dx CSS pixels
   * @param {number} dy CSS pixels, down
   */
  pan(dx, dy) {
    const { right, up } = this.axes();
    const unit = (2 * this.distance * Math.tan(this.fov / 2)) / this._size().height;
    this.target = add(this.target, add(scaled(right, -dx * unit), scaled(up, dy * unit)));
  }

  /**
   * Come closer to what lies at a place of the picture.
   * @param {number} factor of the distance; below 1 comes closer
   * @param {number} [x] CSS pixels from the left of the canvas; without x and y the middle
   * @param {number} [y] CSS pixels from its top
   */
  zoom(factor, x, y) {
    const { width, height } = this._size();
    const { origin, direction } = this.ray(x ?? width / 2, y ?? height / 2);
    const { back } = this.axes();
    // What is under the pointer stays there, and is what the camera turns around at its depth.
    const met = this._hit(origin, direction) ?? add(origin, scaled(direction, -this.distance / dot(direction, back)));
    const depth = -dot(subtract(met, origin), back);
    const [least, most] = this.range;
    const wanted = Math.max(least, Math.min(most, depth * factor));
    const eye = add(met, scaled(subtract(origin, met), wanted / depth));
    this.distance = wanted;
    this.target = subtract(eye, scaled(back, wanted));
  }

  /** Unit vectors: right and up of the picture, and back towards the eye. */
  axes() {
    const { yaw, pitch } = this;
    /** @type {Vector} */
    const back = [Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch), Math.cos(yaw) * Math.cos(pitch)];
    /** @type {Vector} */
    const right = [Math.cos(yaw), 0, -Math.sin(yaw)];
    return { right, up: cross(back, right), back };
  }

  /** @returns {Vector} */
  eye() {
    return add(this.target, scaled(this.axes().back, this.distance));
  }

  /**
   * From the eye through a place of the picture.
   * @param {number} x CSS pixels @param {number} y CSS pixels
   * @returns {{origin: Vector, direction: Vector}}
   */
  ray(x, y) {
    const { width, height } = this._size();
    const { right, up, back } = this.axes();
    const half = Math.tan(this.fov / 2);
    const across = ((2 * x) / width - 1) * half * (width / height), down = ((2 * y) / height - 1) * half;
    const direction = subtract(subtract(scaled(right, across), scaled(up, down)), back);
    return { origin: this.eye(), direction };
  }

  /** To the clip space. @param {number} aspect */
  matrix(aspect) {
    const { right, up, back } = this.axes();
    const near = 0.05 * this.distance;
    const far = Math.hypot(...this.eye()) + 2 * this.radius + near;
    return product(perspective(this.fov, aspect, near, far), lookMatrix(this.eye(), right, up, back));
  }
}
