// The mesh in a pose: positions, smooth normals, and per triangle stretch and the gradients of u and v.

import { Folds } from '../folds.js';
import { logStretch, stretchTexture } from '../stretch.js';

/** @typedef {import('./types.js').SkinPackage} SkinPackage */

// Of a triangle: the gradients of u and v (v down), x, y, z, 0 of each.
export const GRADIENTS = 8;

export class Pose {
  /** @param {SkinPackage} skinPackage */
  constructor({ manifest, mesh, rest }) {
    this._mesh = mesh;
    this._rest = rest;
    this._manifest = manifest;
    this._originals = manifest.mesh.vertices;
    this.positions = Float32Array.from(mesh.positions);
    this.normals = new Float32Array(mesh.positions.length);
    this.gradients = new Float32Array(GRADIENTS * manifest.stretch.triangles);
    this.stretch = stretchTexture(manifest.stretch.triangles, manifest.stretch.triangles_a_row);
    const { folds } = manifest.stretch;
    this._folds = folds ? new Folds(mesh.positions, mesh.indices, rest, folds) : null;
    /** Time that the stretch took, and what folds take of it. */
    this.stretchMilliseconds = 0;
    this._sums = new Float64Array(3 * this._originals);
    this._sum = Float64Array.from(mesh.positions);
    this.set([]);
  }

  /** @param {ArrayLike<number>} weights one of every shape; 0 where there are fewer */
  set(weights) {
    this._move(weights);
    const start = performance.now();
    logStretch(this.positions, this._mesh.indices, this._rest, this.stretch);
    this._folds?.write(this.positions, this.stretch);
    this.stretchMilliseconds = performance.now() - start;
    this._turn();
    this._derive();
  }

  /** In the original order, with the centre of the mesh. */
  original() {
    const { centre } = this._manifest.mesh;
    return this.positions.slice(0, 3 * this._originals).map((value, i) => value + centre[i % 3]);
  }

  /** @param {ArrayLike<number>} weights */
  _move(weights) {
    const { positions, shapes } = this._mesh;
    const sum = this._sum;
    sum.set(positions);
    shapes.forEach(({ offsets }, shape) => {
      const weight = weights[shape] ?? 0;
      if (weight === 0) return;
      for (let i = 0; i < sum.length; i++) sum[i] += weight * offsets[i];
    });
    this.positions.set(sum);
  }

  /** Normals: means of the triangles around an original vertex by area, so that seams do not show. */
  _turn() {
    const { indices, vertex } = this._mesh, p = this.positions, sums = this._sums.fill(0);
    for (let t = 0; t < indices.length; t += 3) {
      const [i, j, k] = [3 * indices[t], 3 * indices[t + 1], 3 * indices[t + 2]];
      const ax = p[j] - p[i], ay = p[j + 1] - p[i + 1], az = p[j + 2] - p[i + 2];
      const bx = p[k] - p[i], by = p[k + 1] - p[i + 1], bz = p[k + 2] - p[i + 2];
      const x = ay * bz - az * by, y = az * bx - ax * bz, z = ax * by - ay * bx;
      for (let corner = 0; corner < 3; corner++) {
        const at = 3 * vertex[indices[t + corner]];
        sums[at] += x;
        sums[at + 1] += y;
        sums[at + 2] += z;
      }
    }
    for (let i = 0; i < vertex.length; i++) {
      const at = 3 * vertex[i];
      const length = Math.hypot(sums[at], sums[at + 1], sums[at + 2]) || 1;
      for (let axis = 0; axis < 3; axis++) this.normals[3 * i + axis] = sums[at + axis] / length;
    }
  }

  /** The gradients of u and v in every triangle: of the edges e1 and e2 and the normal n = e1 x e2,
   * those of the barycentric coordinates are e2 x n / n.n and n x e1 / n.n. */
  _derive() {
    const { indices, uvs } = this._mesh, p = this.positions, out = this.gradients;
    for (let t = 0, to = 0; t < indices.length; t += 3, to += GRADIENTS) {
      const a = indices[t], b = indices[t + 1], c = indices[t + 2];
      const [i, j, k] = [3 * a, 3 * b, 3 * c];
      const ax = p[j] - p[i], ay = p[j + 1] - p[i + 1], az = p[j + 2] - p[i + 2];
      const bx = p[k] - p[i], by = p[k + 1] - p[i + 1], bz = p[k + 2] - p[i + 2];
      const x = ay * bz - az * by, y = az * bx - ax * bz, z = ax * by - ay * bx;
      const area = x * x + y * y + z * z;
      const s = area > 0 ? 1 / area : 0;
      for (let axis = 0; axis < 2; axis++) {
        const d1 = s * (uvs[2 * b + axis] - uvs[2 * a + axis]);
        const d2 = s * (uvs[2 * c + axis] - uvs[2 * a + axis]);
        const at = to + 4 * axis;
        out[at] = d1 * (by * z - bz * y) + d2 * (y * az - z * ay);
        out[at + 1] = d1 * (bz * x - bx * z) + d2 * (z * ax - x * az);
        out[at + 2] = d1 * (bx * y - by * x) + d2 * (x * ay - y * ax);
      }
    }
  }
}
