// Vectors of three and matrices of 4 x 4, column by column, as WebGL takes them.

/** @typedef {import('./types.js').Vector} Vector */

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {Vector} a @param {number} s @returns {Vector} */
export const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
/** @param {Vector} a @param {Vector} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
/** @param {Vector} a @returns {Vector} of length 1; z where it has none */
export const normalized = (a) => {
  const length = Math.hypot(...a);
  return length > 0 ? scaled(a, 1 / length) : [0, 0, 1];
};

/**
 * What takes points to the axes right, up and back of an eye.
 * @param {Vector} eye @param {Vector} right @param {Vector} up @param {Vector} back
 */
export function lookMatrix(eye, right, up, back) {
  const rows = [right, up, back];
  const columns = [0, 1, 2].flatMap((i) => [...rows.map((row) => row[i]), 0]);
  return new Float32Array([...columns, ...rows.map((row) => -dot(row, eye)), 1]);
}

/** @param {number} fov of the height, radians @param {number} aspect @param {number} near @param {number} far */
export function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2), depth = near - far;
  return new Float32Array([
    f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / depth, -1, 0, 0, (2 * far * near) / depth, 0,
  ]);
}

/** A box of `radius` around the origin to the clip space. @param {number} radius */
export function orthographic(radius) {
  const s = 1 / radius;
  return new Float32Array([s, 0, 0, 0, 0, s, 0, 0, 0, 0, -s, 0, 0, 0, 0, 1]);
}

/** a b. @param {Float32Array} a @param {Float32Array} b */
export function product(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * column + k];
      out[4 * column + row] = sum;
    }
  return out;
}
