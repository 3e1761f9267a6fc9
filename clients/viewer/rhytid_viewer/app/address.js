// The part of the address after #, which restores what the page shows.

import { initialState } from "./state.js";

/**
 * @typedef {import('./state.js').State} State
 * @typedef {import('../view/types.js').Vector} Vector
 * @typedef {{target: Vector, distance: number, yaw: number, pitch: number, fov: number}} Place of a camera
 */

const METHODS = ["neutral", "fast", "exact"];

/**
 * @param {State} state
 * @param {Place | null} camera
 * @returns {string} without #
 */
export function written(state, camera) {
  const initial = initialState();
  const found = new URLSearchParams();
  if (state.asset) found.set("asset", state.asset);
  if (state.method !== initial.method) found.set("method", state.method);
  if (state.strength !== initial.strength) found.set("relief", short(state.strength));
  if (state.colours !== initial.colours) found.set("colours", state.colours);
  if (state.axes) found.set("axes", "1");
  if (state.split !== null) found.set("split", short(state.split));
  if (String(state.light) !== String(initial.light)) found.set("light", listed(state.light));
  if (camera) {
    found.set("camera", listed([...camera.target, camera.distance, camera.yaw, camera.pitch, camera.fov]));
  }
  const weights = Object.entries(state.weights).map(([name, value]) => `${escaped(name)}:${short(value)}`);
  if (weights.length) found.set("weights", weights.join(","));
  return found.toString().replaceAll("%2C", ",").replaceAll("%3A", ":");
}

/**
 * What cannot be read is left as it is at first.
 * @param {string} hash with or without #
 * @returns {{state: State, camera: Place | null}}
 */
export function read(hash) {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const state = initialState();
  state.asset = given.get("asset");
  const method = given.get("method") ?? "";
  if (METHODS.includes(method)) state.method = /** @type {State["method"]} */ (method);
  state.strength = clamped(given.get("relief"), 0, 3) ?? state.strength;
  if (given.get("colours") === "stretch") state.colours = "stretch";
  state.axes = given.get("axes") === "1";
  state.split = clamped(given.get("split"), 0, 1);
  const light = numbers(given.get("light"), 3);
  if (light && Math.hypot(...light) > 0) state.light = /** @type {Vector} */ (light);
  state.weights = weightsOf(given.get("weights"));
  return { state, camera: cameraOf(numbers(given.get("camera"), 7)) };
}

/** @param {string | null} text */
function weightsOf(text) {
  /** @type {Map<string, number>} */
  const found = new Map();
  for (const part of (text ?? "").split(",")) {
    const at = part.lastIndexOf(":");
    const value = clamped(part.slice(at + 1), -10, 10);
    if (at > 0 && value) found.set(unescaped(part.slice(0, at)), value);
  }
  return Object.fromEntries(found);
}

/** A comma ends a weight; in a name it is written as %2C. @param {string} name */
function escaped(name) {
  return name.replace(/[%,]/g, encodeURIComponent);
}

/** @param {string} text */
function unescaped(text) {
  return text.replace(/%(2C|25)/g, decodeURIComponent);
}

/** @param {number[] | null} all @returns {Place | null} */
function cameraOf(all) {
  if (!all || all[3] <= 0 || all[6] <= 0 || all[6] >= Math.PI) return null;
  return { target: [all[0], all[1], all[2]], distance: all[3], yaw: all[4], pitch: all[5], fov: all[6] };
}

/** @param {string | null} text @param {number} count */
function numbers(text, count) {
  const found = (text ?? "").split(",").map((part) => (part.trim() ? Number(part) : NaN));
  return found.length === count && found.every(Number.isFinite) ? found : null;
}

/** @param {string | null} text @param {number} low @param {number} high */
function clamped(text, low, high) {
  const value = text === null || !text.trim() ? NaN : Number(text);
  return Number.isFinite(value) ? Math.min(high, Math.max(low, value)) : null;
}

/** @param {readonly number[]} values */
function listed(values) {
  return values.map(short).join(",");
}

/** @param {number} value */
function short(value) {
  return String(Number(value.toPrecision(6)));
}
