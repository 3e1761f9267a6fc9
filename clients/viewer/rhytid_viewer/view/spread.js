// Which triangles stand for those around them, the sparser the fewer are shown.

const SPARSEST = 3; // of the radius of the mesh, its part
const FINER = 1.6;
const STEPS = 12;

/**
 * Of every triangle the distance that it keeps from all that keep as much: those of at least r are
 * spread evenly, about r apart, for every r.
 * @param {Float32Array} positions
 * @param {Uint32Array} indices
 * @param {number} radius of the mesh around its middle
 * @returns {Float32Array} mesh units; 0 of those that stand too close for any
 */
export function spread(positions, indices, radius) {
  const middles = middlesOf(positions, indices);
  const out = new Float32Array(indices.length / 3);
  /** @type {number[]} */
  let left = Array.from(out.keys());
  /** @type {number[]} */
  const taken = [];
  for (let step = 0, apart = radius / SPARSEST; step < STEPS && left.length; step++, apart /= FINER) {
    const grid = new Grid(middles, apart);
    for (const t of taken) grid.add(t);
    left = left.filter((t) => {
      if (grid.near(t)) return true;
      grid.add(t);
      taken.push(t);
      out[t] = apart;
      return false;
    });
  }
  return out;
}

/** Points by the cell that they lie in. */
class Grid {
  /** @param {Float32Array} points @param {number} size of a cell */
  constructor(points, size) {
    this._points = points;
    this._size = size;
    /** @type {Map<number, number[]>} */
    this._cells = new Map();
  }

  /** @param {number} i of a point */
  add(i) {
    const key = keyOf(...this._cell(i)), found = this._cells.get(key);
    if (found) found.push(i);
    else this._cells.set(key, [i]);
  }

  /** Whether another one is closer than the size of a cell. @param {number} i of a point */
  near(i) {
    const [x, y, z] = this._cell(i);
    for (let n = 0; n < 27; n++) {
      const others = this._cells.get(keyOf(x + (n % 3) - 1, y + (Math.floor(n / 3) % 3) - 1, z + Math.floor(n / 9) - 1));
      if (others?.some((other) => this._apart(i, other) < this._size)) return true;
    }
    return false;
  }

  /** @param {number} i @returns {[number, number, number]} */
  _cell(i) {
    const at = (/** @type {number} */ axis) => Math.floor(this._points[3 * i + axis] / this._size);
    return [at(0), at(1), at(2)];
  }

  /** @param {number} i @param {number} j */
  _apart(i, j) {
    const p = this._points;
    return Math.hypot(p[3 * i] - p[3 * j], p[3 * i + 1] - p[3 * j + 1], p[3 * i + 2] - p[3 * j + 2]);
  }
}

/** One number of three whole ones around 0. @param {number} x @param {number} y @param {number} z */
function keyOf(x, y, z) {
  return ((x + 8192) * 16384 + (y + 8192)) * 16384 + z + 8192;
}

/** @param {Float32Array} positions @param {Uint32Array} indices */
function middlesOf(positions, indices) {
  const out = new Float32Array(indices.length);
  for (let t = 0; t < indices.length; t += 3)
    for (let axis = 0; axis < 3; axis++)
      for (let corner = 0; corner < 3; corner++) out[t + axis] += positions[3 * indices[t + corner] + axis] / 3;
  return out;
}
