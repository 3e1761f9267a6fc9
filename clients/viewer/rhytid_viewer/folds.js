// What folds of a deformed mesh take of its log compression, for the shader's texture of stretch.
// Part of a skin package of rhytid; an ES module without dependencies. Numbers are doubles.

const LEAST_SQUARE = 1e-12; // of a ratio: of a triangle that is pressed to nothing
const REST = 8;

export class Folds {
  /**
   * The folds of a mesh, ready for any frame.
   * @param {ArrayLike<number>} positions x, y, z of every vertex of the neutral, in the unit of the package
   * @param {ArrayLike<number>} indices three of every triangle, into positions
   * @param {Float64Array} rest of readRest
   * @param {{length: number, most: number, least: number, most_bend: number, rounds: number, normal_rounds: number}}
   *     numbers stretch.folds of the manifest; where it is null folds take nothing
   */
  constructor(positions, indices, rest, numbers) {
    this._rest = rest;
    this._indices = indices;
    this._numbers = numbers;
    this._triangles = rest.length / REST;
    this._corners = new Uint32Array(3 * this._triangles);
    this._places = placesOf(positions, indices, this._corners);
    this._areas = new Float64Array(this._triangles);
    this._sums = new Float64Array(this._places);
    const normal = [0, 0, 0];
    for (let t = 0; t < this._triangles; t++) {
      if (!(rest[REST * t + 3] > 0)) continue;
      this._cross(positions, t, normal);
      this._areas[t] = Math.hypot(normal[0], normal[1], normal[2]);
      for (let k = 0; k < 3; k++) this._sums[this._corners[3 * t + k]] += this._areas[t];
    }
    this._form = new Float64Array(6);
    this._before = new Float64Array(3 * this._triangles);
    const normals = this._normals(positions);
    for (let t = 0; t < this._triangles; t++) {
      this._forms(positions, normals, t);
      this._before.set(this._form.subarray(3), 3 * t);
    }
  }

  /**
   * Write the share that folds take of the compression of each triangle in a frame into the texture
   * of stretch, after log rho2.
   * @param {ArrayLike<number>} positions of the frame
   * @param {Float32Array} out of stretchTexture
   */
  write(positions, out) {
    const { rounds, most, least } = this._numbers, corners = this._corners;
    const moments = this._smoothed(this._bends(positions), 2, rounds);
    const shares = new Float64Array(this._places);
    for (let w = 0; w < this._places; w++) {
      const mean = moments[2 * w];
      const variance = Math.max(moments[2 * w + 1] - mean * mean - least, 0);
      shares[w] = most * (1 - Math.pow(1 + variance, -0.25));
    }
    for (let t = 0; t < this._triangles; t++)
      out[REST * t + 6] =
        (shares[corners[3 * t]] + shares[corners[3 * t + 1]] + shares[corners[3 * t + 2]]) / 3;
  }

  /** @param {ArrayLike<number>} positions @returns {Float64Array} b and its square of each triangle */
  _bends(positions) {
    const normals = this._normals(positions), moments = new Float64Array(2 * this._triangles);
    for (let t = 0; t < this._triangles; t++) {
      if (!(this._rest[REST * t + 3] > 0)) continue;
      this._forms(positions, normals, t);
      const b = this._bend(t);
      moments[2 * t] = b;
      moments[2 * t + 1] = b * b;
    }
    return moments;
  }

  /** b of a triangle whose forms are there. @param {number} t */
  _bend(t) {
    const xx = this._form[0], xy = this._form[1], yy = this._form[2];
    const { length, most_bend: most } = this._numbers;
    const mean = 0.5 * (xx + yy), apart = 0.5 * (xx - yy), radius = Math.hypot(apart, xy);
    const cosine = radius > 0 ? apart / radius : 0, sine = radius > 0 ? xy / radius : 0;
    const first = mean + radius, second = first > 0 ? (xx * yy - xy * xy) / first : 0;
    let b = 0;
    for (let sign = 1; sign >= -1; sign -= 2) {
      const square = Math.max(sign > 0 ? first : second, LEAST_SQUARE);
      const pressed = Math.min(Math.max(-0.5 * Math.log(square), 0), 1);
      const bent =
        along(this._form, 3, sign * cosine, sign * sine) / square -
        along(this._before, 3 * t, sign * cosine, sign * sine);
      b += pressed * Math.min(Math.max(length * bent, -most), most);
    }
    return b;
  }

  /**
   * Both fundamental forms, xx, xy, yy of each, along the axes of the frame of the neutral triangle.
   * @param {ArrayLike<number>} p positions @param {Float64Array} normals @param {number} t
   */
  _forms(p, normals, t) {
    const rest = this._rest, at = this._indices, corners = this._corners;
    const x1 = rest[REST * t], y2 = rest[REST * t + 2], y1 = -rest[REST * t + 1] * y2;
    const a = 3 * at[3 * t], b = 3 * at[3 * t + 1], c = 3 * at[3 * t + 2];
    const m = 3 * corners[3 * t], n = 3 * corners[3 * t + 1], o = 3 * corners[3 * t + 2];
    const form = this._form.fill(0);
    for (let k = 0; k < 3; k++) {
      const e1 = p[b + k] - p[a + k], e2 = p[c + k] - p[a + k];
      const m1 = normals[n + k] - normals[m + k], m2 = normals[o + k] - normals[m + k];
      const x = x1 * e1, y = y1 * e1 + y2 * e2, nx = x1 * m1, ny = y1 * m1 + y2 * m2;
      form[0] += x * x;
      form[1] += x * y;
      form[2] += y * y;
      form[3] += nx * x;
      form[4] += 0.5 * (nx * y + ny * x);
      form[5] += ny * y;
    }
  }

  /** @param {ArrayLike<number>} positions @returns {Float64Array} of each place */
  _normals(positions) {
    const found = new Float64Array(3 * this._places), normal = [0, 0, 0];
    for (let t = 0; t < this._triangles; t++) {
      if (!(this._rest[REST * t + 3] > 0)) continue;
      this._cross(positions, t, normal);
      for (let k = 0; k < 3; k++)
        for (let i = 0; i < 3; i++) found[3 * this._corners[3 * t + k] + i] += normal[i];
    }
    for (let at = 0; at < found.length; at += 3) {
      const size = Math.max(Math.hypot(found[at], found[at + 1], found[at + 2]), 1e-300);
      for (let i = 0; i < 3; i++) found[at + i] /= size;
    }
    const rounds = this._numbers.normal_rounds;
    return rounds > 0 ? this._smoothed(this._spread(found, 3), 3, rounds) : found;
  }

  /**
   * Means over the triangles around each place, by area.
   * @param {Float64Array} triangles @param {number} width @param {number} rounds
   */
  _smoothed(triangles, width, rounds) {
    let places = new Float64Array(0);
    for (let left = rounds - 1; left >= 0; left--) {
      places = new Float64Array(width * this._places);
      for (let t = 0; t < this._triangles; t++)
        for (let k = 0; k < 3; k++)
          for (let i = 0; i < width; i++)
            places[width * this._corners[3 * t + k] + i] += this._areas[t] * triangles[width * t + i];
      for (let at = 0; at < places.length; at++)
        places[at] /= Math.max(this._sums[Math.floor(at / width)], 1e-300);
      if (left > 0) triangles = this._spread(places, width);
    }
    return places;
  }

  /** Means of the corners of each triangle. @param {Float64Array} places @param {number} width */
  _spread(places, width) {
    const found = new Float64Array(width * this._triangles), corners = this._corners;
    for (let t = 0; t < this._triangles; t++)
      for (let i = 0; i < width; i++)
        found[width * t + i] =
          (places[width * corners[3 * t] + i] + places[width * corners[3 * t + 1] + i] +
            places[width * corners[3 * t + 2] + i]) / 3;
    return found;
  }

  /** @param {ArrayLike<number>} positions @param {number} t @param {number[]} out */
  _cross(positions, t, out) {
    const p = 3 * this._indices[3 * t], q = 3 * this._indices[3 * t + 1];
    const r = 3 * this._indices[3 * t + 2];
    for (let k = 0; k < 3; k++) {
      const i = (k + 1) % 3, j = (k + 2) % 3;
      out[k] =
        (positions[q + i] - positions[p + i]) * (positions[r + j] - positions[p + j]) -
        (positions[q + j] - positions[p + j]) * (positions[r + i] - positions[p + i]);
    }
  }
}

/**
 * A form along an axis of stretch, by the cosine and the sine of twice its angle.
 * @param {Float64Array} form @param {number} at of xx, xy, yy
 * @param {number} cosine @param {number} sine
 */
function along(form, at, cosine, sine) {
  const mean = 0.5 * (form[at] + form[at + 2]), apart = 0.5 * (form[at] - form[at + 2]);
  return mean + apart * cosine + form[at + 1] * sine;
}

/**
 * Number the places of vertices: those at one place, split at UV seams, are one.
 * @param {ArrayLike<number>} positions @param {ArrayLike<number>} indices
 * @param {Uint32Array} corners the place of every corner, written
 */
function placesOf(positions, indices, corners) {
  /** @type {Map<string, number>} */
  const places = new Map();
  for (let at = 0; at < corners.length; at++) {
    const p = 3 * indices[at];
    const key = `${positions[p] + 0},${positions[p + 1] + 0},${positions[p + 2] + 0}`;
    let place = places.get(key);
    if (place === undefined) places.set(key, (place = places.size));
    corners[at] = place;
  }
  return places.size;
}
