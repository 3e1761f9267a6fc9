// Log stretch and axes of every triangle of a deformed mesh, in the layout of the shader's texture.
// Part of a skin package of rhytid; an ES module without dependencies. Numbers of JavaScript are
// doubles: positions and what comes out are float32, nothing between them is.

const LEAST_LOG = -100; // of a triangle that is pressed to nothing
const REST = 8;

/**
 * Numbers of every triangle, from the bytes of a package's triangles.bin.
 * @param {ArrayBuffer} bytes
 * @returns {Float64Array}
 */
export function readRest(bytes) {
  return new Float64Array(bytes);
}

/**
 * Floats of the texture: two RGBA texels of each triangle, perRow triangles in a row, and one
 * unstretched entry after the last, for texels in no triangle. Reuse it for every frame.
 * @param {number} triangles
 * @param {number} perRow
 * @returns {Float32Array}
 */
export function stretchTexture(triangles, perRow) {
  const rows = Math.ceil((triangles + 1) / perRow);
  const out = new Float32Array(rows * perRow * 8);
  for (let at = 0; at < out.length; at += 8) {
    out[at] = 1;
    out[at + 3] = 1;
  }
  return out;
}

/**
 * Fill the texture for a frame: of each triangle the unit axes s1 and s2 in UV, log rho1 and
 * log rho2, not clamped, rho1 >= rho2, and 0, 0; `Folds` of folds.js writes the first of these.
 * @param {ArrayLike<number>} positions x, y, z of every vertex, in the unit of the package
 * @param {ArrayLike<number>} indices three of every triangle, into positions
 * @param {Float64Array} rest of readRest
 * @param {Float32Array} out of stretchTexture
 */
export function logStretch(positions, indices, rest, out) {
  const triangles = rest.length / REST;
  for (let t = 0, at = 0; t < triangles; t++, at += REST) {
    out[at + 6] = 0;
    if (!(rest[at + 3] > 0)) {
      unstretched(out, at);
      continue;
    }
    const p = 3 * indices[3 * t], q = 3 * indices[3 * t + 1], r = 3 * indices[3 * t + 2];
    const x1 = positions[q] - positions[p];
    const y1 = positions[q + 1] - positions[p + 1];
    const z1 = positions[q + 2] - positions[p + 2];
    const x2 = positions[r] - positions[p];
    const y2 = positions[r + 1] - positions[p + 1];
    const z2 = positions[r + 2] - positions[p + 2];
    const length = Math.sqrt(x1 * x1 + y1 * y1 + z1 * z1);
    let d, h;
    if (length > 0) {
      const cx = y1 * z2 - z1 * y2, cy = z1 * x2 - x1 * z2, cz = x1 * y2 - y1 * x2;
      d = (x1 * x2 + y1 * y2 + z1 * z2) / length;
      h = Math.sqrt(cx * cx + cy * cy + cz * cz) / length;
    } else { // the first edge is a point: lay the second along the axis
      d = Math.sqrt(x2 * x2 + y2 * y2 + z2 * z2);
      h = 0;
    }
    const a = length * rest[at];
    const b = (d - length * rest[at + 1]) * rest[at + 2];
    principal(a, b, h * rest[at + 2], rest, at, out);
  }
}

/**
 * The singular values of [[a, b], [0, d]] and the right singular vectors in UV.
 * @param {number} a @param {number} b @param {number} d
 * @param {Float64Array} rest
 * @param {number} at of the triangle
 * @param {Float32Array} out
 */
function principal(a, b, d, rest, at, out) {
  const sum = a + d, difference = a - d;
  const larger =
    (Math.sqrt(sum * sum + b * b) + Math.sqrt(difference * difference + b * b)) / 2;
  const smaller = larger > 0 ? (a * d) / larger : 0; // of the determinant: nothing cancels
  const c = difference * sum - b * b, s = 2 * a * b, radius = Math.sqrt(c * c + s * s);
  let x = c > 0 ? radius + c : Math.abs(s);
  let y = c > 0 ? s : s < 0 || Object.is(s, -0) ? c - radius : radius - c;
  if (!(x * x + y * y > 0)) { // stretched alike in all directions
    x = 1;
    y = 0;
  }
  axis(x, y, rest, at, out, at);
  axis(-y, x, rest, at, out, at + 2);
  out[at + 4] = Math.max(Math.log(larger), LEAST_LOG);
  out[at + 5] = Math.max(Math.log(smaller), LEAST_LOG);
}

/**
 * A direction in the frame of the triangle, as unit vector in UV.
 * @param {number} x @param {number} y
 * @param {Float64Array} rest
 * @param {number} at of the triangle
 * @param {Float32Array} out
 * @param {number} to where in out
 */
function axis(x, y, rest, at, out, to) {
  const u = rest[at + 4] * x + rest[at + 5] * y, v = rest[at + 6] * x + rest[at + 7] * y;
  const length = Math.sqrt(u * u + v * v);
  out[to] = u / length;
  out[to + 1] = v / length;
}

/** @param {Float32Array} out @param {number} at of the triangle */
function unstretched(out, at) {
  out[at] = out[at + 3] = 1;
  out[at + 1] = out[at + 2] = out[at + 4] = out[at + 5] = 0;
}
