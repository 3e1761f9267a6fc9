// Where a ray meets the posed mesh.

/** @typedef {import('./types.js').Vector} Vector */

/**
 * The nearest triangle that a ray meets from its front.
 * @param {Float32Array} positions
 * @param {Uint32Array} indices
 * @param {Vector} origin
 * @param {Vector} direction of any length
 * @returns {{triangle: number, distance: number, weights: Vector} | null} distance in lengths of the
 *   direction; weights of the three corners
 */
export function pick(positions, indices, origin, direction) {
  let best = null, least = Infinity;
  const [dx, dy, dz] = direction, p = positions;
  for (let t = 0; t < indices.length; t += 3) {
    const i = 3 * indices[t], j = 3 * indices[t + 1], k = 3 * indices[t + 2];
    const ax = p[j] - p[i], ay = p[j + 1] - p[i + 1], az = p[j + 2] - p[i + 2];
    const bx = p[k] - p[i], by = p[k + 1] - p[i + 1], bz = p[k + 2] - p[i + 2];
    const hx = dy * bz - dz * by, hy = dz * bx - dx * bz, hz = dx * by - dy * bx;
    const area = ax * hx + ay * hy + az * hz;
    if (!(area > 0)) continue; // seen from behind
    const sx = origin[0] - p[i], sy = origin[1] - p[i + 1], sz = origin[2] - p[i + 2];
    const u = sx * hx + sy * hy + sz * hz;
    if (u < 0 || u > area) continue;
    const qx = sy * az - sz * ay, qy = sz * ax - sx * az, qz = sx * ay - sy * ax;
    const v = dx * qx + dy * qy + dz * qz;
    if (v < 0 || u + v > area) continue;
    const distance = (bx * qx + by * qy + bz * qz) / area;
    if (distance <= 0 || distance >= least) continue;
    least = distance;
    best = { triangle: t / 3, distance, weights: /** @type {Vector} */ ([(area - u - v) / area, u / area, v / area]) };
  }
  return best;
}
