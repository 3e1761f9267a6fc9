// What the page shows, but for the camera, which the view has.

/**
 * @typedef {import('../view/types.js').Method} Method
 * @typedef {import('../view/types.js').Vector} Vector
 *
 * @typedef {object} State
 * @property {string | null} asset id, in a service
 * @property {Method} method
 * @property {number} strength factor of the relief
 * @property {'skin' | 'stretch'} colours
 * @property {boolean} axes
 * @property {number | null} split share of the width from the left that is neutral
 * @property {Vector} light towards it, in the axes of the mesh
 * @property {Readonly<Record<string, number>>} weights of the shapes that are not 0, by name
 */

/** Grazing, from above and the right. @type {Vector} */
export const LIGHT = [0.5, 0.8, 0.3];

/** @returns {State} */
export function initialState() {
  return {
    asset: null,
    method: "fast",
    strength: 1,
    colours: "skin",
    axes: false,
    split: null,
    light: [...LIGHT],
    weights: {},
  };
}

/** Holds the state and tells who listens what changed. */
export class Store {
  constructor() {
    this.state = initialState();
    /** @type {((state: State, changed: ReadonlySet<keyof State>) => void)[]} */
    this.listeners = [];
  }

  /** @param {(state: State, changed: ReadonlySet<keyof State>) => void} listener */
  listen(listener) {
    this.listeners.push(listener);
  }

  /**
   * Change some of it; listeners hear of what became different.
   * @param {Partial<State>} changes
   */
  set(changes) {
    const before = this.state;
    const keys = /** @type {(keyof State)[]} */ (Object.keys(changes));
    const different = keys.filter((key) => changes[key] !== undefined && !same(changes[key], before[key]));
    if (!different.length) return;
    this.state = { ...before, ...Object.fromEntries(different.map((key) => [key, changes[key]])) };
    const changed = new Set(different);
    for (const listener of this.listeners) listener(this.state, changed);
  }

  /**
   * The weight of one shape; others stay.
   * @param {string} name
   * @param {number} value
   */
  setWeight(name, value) {
    const weights = { ...this.state.weights, [name]: value };
    if (value === 0) delete weights[name];
    this.set({ weights });
  }
}

/**
 * The weight of a shape, 0 where none is set: a shape may have any name, such as `constructor`.
 * @param {Readonly<Record<string, number>>} weights
 * @param {string} name
 */
export function weightOf(weights, name) {
  return Object.hasOwn(weights, name) ? weights[name] : 0;
}

/** @param {unknown} one @param {unknown} other */
function same(one, other) {
  return one === other || JSON.stringify(one) === JSON.stringify(other);
}
