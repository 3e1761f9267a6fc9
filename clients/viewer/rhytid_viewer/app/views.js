// Where to look on a face: at the whole of it, and close at its skin.

import { pick } from "../view/pick.js";
import { byId, make } from "./dom.js";
import { groupOf } from "./shape_names.js";

/**
 * @typedef {import('../view/types.js').Vector} Vector
 * @typedef {import('../view/types.js').PackageMesh} PackageMesh
 * @typedef {import('./address.js').Place} Place
 * @typedef {{name: string, place: Place}} View
 * @typedef {{middle: Vector, height: number}} Box
 */

/** How much of a face is in the picture, from top to bottom, in heights of the eyes over the mouth. */
const SHOWN = { Face: 3.6, Forehead: 0.95, Eye: 0.75, Cheek: 0.75, Mouth: 0.9 };
/** What shows most skin is the first view. */
export const FIRST = "Cheek";
/** Where they are on a face that no shapes tell of: right and up of its middle, in its height. */
const USUAL = { forehead: [0, 0.28], eye: [0.15, 0.08], cheek: [0.19, -0.05], mouth: [0, -0.2] };
/** A vertex that shapes move by less than this share of the most is not of the face. */
const STILL = 0.08;

/**
 * The views of a face that looks along z, by its shapes where their names tell the parts of a face.
 * @param {PackageMesh} mesh
 * @param {number} fov of the camera, radians
 * @returns {View[]}
 */
export function viewsOf(mesh, fov) {
  const { middle, unit, parts } = partsOf(mesh, faceBox(mesh));
  const distance = (/** @type {keyof typeof SHOWN} */ name) => (SHOWN[name] * unit) / (2 * Math.tan(fov / 2));
  /** @type {View[]} */
  const found = [{ name: "Face", place: { target: middle, distance: distance("Face"), yaw: 0, pitch: 0, fov } }];
  for (const name of /** @type {const} */ (["Forehead", "Eye", "Cheek", "Mouth"])) {
    const near = onSurface(mesh, parts[name], 0.3 * unit);
    if (near) found.push({ name, place: { ...near, distance: distance(name), fov } });
  }
  return found;
}

/** The buttons of the views, and the key that goes through them. */
export class ViewsBar {
  /** @param {(place: Place) => void} go */
  constructor(go) {
    this.go = go;
    /** @type {View[]} */
    this.views = [];
    this.at = 0;
  }

  /** @param {View[]} views */
  fill(views) {
    this.views = views;
    this.at = views.findIndex(({ name }) => name === FIRST);
    const buttons = views.map(({ name }, index) => {
      const button = make("button", { type: "button", title: `Look at the ${name.toLowerCase()} (V: the next)` }, [name]);
      button.addEventListener("click", () => this.show(index));
      return button;
    });
    byId("views", HTMLDivElement).replaceChildren(...buttons);
  }

  /** @param {number} index */
  show(index) {
    this.at = index;
    this.go(this.views[index].place);
  }

  next() {
    if (this.views.length) this.show((this.at + 1) % this.views.length);
  }
}

/** Of the vertices that shapes move, else of all. @param {PackageMesh} mesh @returns {Box} */
function faceBox({ positions, shapes }) {
  const moved = movedBy(positions, shapes.map(({ offsets }) => offsets));
  const still = moved.some((value) => value > 0) ? STILL : 0;
  /** @type {Vector} */
  const low = [Infinity, Infinity, Infinity];
  /** @type {Vector} */
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i += 3) {
    if (moved[i / 3] < still) continue;
    for (let axis = 0; axis < 3; axis += 1) {
      low[axis] = Math.min(low[axis], positions[i + axis]);
      high[axis] = Math.max(high[axis], positions[i + axis]);
    }
  }
  const middle = /** @type {Vector} */ (low.map((value, axis) => (value + high[axis]) / 2));
  return { middle, height: Math.max(high[1] - low[1], high[0] - low[0]) };
}

/**
 * Where the parts of a face are, x and y, and how far the eyes are above the mouth.
 * @param {PackageMesh} mesh
 * @param {Box} box
 */
function partsOf(mesh, { middle, height }) {
  const [x, y, z] = middle;
  const usual = (/** @type {keyof typeof USUAL} */ part) => [x + USUAL[part][0] * height, y + USUAL[part][1] * height];
  const of = (/** @type {string[]} */ groups, /** @type {RegExp} */ best, aside = false) => {
    const all = mesh.shapes.filter(({ name }) => groups.includes(groupOf(name)));
    const chosen = all.filter(({ name }) => best.test(name));
    const moved = movedBy(mesh.positions, (chosen.length ? chosen : all).map(({ offsets }) => offsets));
    return centreOf(mesh.positions, moved, aside ? x : -Infinity);
  };
  const eye = of(["eye"], /blink/i, true);
  const mouth = of(["mouth"], /smile|pucker|funnel/i);
  const brow = of(["brow"], /./);
  const unit = eye && mouth ? eye[1] - mouth[1] : 0;
  // Eyes below the mouth, or nearly beside it: the names mean something else.
  if (!eye || !mouth || unit < 0.1 * height) {
    const parts = { Forehead: usual("forehead"), Eye: usual("eye"), Cheek: usual("cheek"), Mouth: usual("mouth") };
    return { middle, unit: height / SHOWN.Face, parts };
  }
  const parts = {
    Forehead: [x, Math.max(brow?.[1] ?? -Infinity, eye[1] + 0.45 * unit) + 0.15 * unit],
    Eye: [eye[0] + 0.2 * unit, eye[1]],
    Cheek: [eye[0] + 0.25 * unit, mouth[1] + 0.6 * unit],
    Mouth: mouth,
  };
  return { middle: /** @type {Vector} */ ([x, eye[1] - 0.25 * unit, z]), unit, parts };
}

/** How far shapes move each vertex, the one that is moved most by 1. @param {Float32Array} positions @param {Float32Array[]} shapes */
function movedBy(positions, shapes) {
  const moved = new Float64Array(positions.length / 3);
  for (const offsets of shapes) {
    for (let i = 0; i < moved.length; i += 1) {
      moved[i] = Math.max(moved[i], Math.hypot(offsets[3 * i], offsets[3 * i + 1], offsets[3 * i + 2]));
    }
  }
  const most = moved.reduce((one, other) => Math.max(one, other), 0);
  return most > 0 ? moved.map((value) => value / most) : moved;
}

/**
 * The mean of places by how far they move, right of a place.
 * @param {Float32Array} positions @param {Float64Array} moved @param {number} right
 * @returns {number[] | null} x, y
 */
function centreOf(positions, moved, right) {
  let [x, y, sum] = [0, 0, 0];
  for (let i = 0; i < moved.length; i += 1) {
    if (positions[3 * i] <= right) continue;
    const weight = moved[i] ** 2;
    x += weight * positions[3 * i];
    y += weight * positions[3 * i + 1];
    sum += weight;
  }
  return sum > 0 ? [x / sum, y / sum] : null;
}

/**
 * The surface behind x and y, seen from the front, and how a camera looks straight at it.
 * @param {PackageMesh} mesh @param {number[]} at @param {number} around mesh units whose normals count
 * @returns {{target: Vector, yaw: number, pitch: number} | null} null where there is no surface
 */
function onSurface({ positions, indices }, [x, y], around) {
  const front = positions.reduce((most, value, index) => (index % 3 === 2 ? Math.max(most, value) : most), -Infinity) + 1;
  const hit = pick(positions, indices, [x, y, front], [0, 0, -1]);
  if (!hit) return null;
  /** @type {Vector} */
  const target = [x, y, front - hit.distance];
  const normal = normalAround(positions, indices, target, around);
  const steep = Math.asin(normal[1]);
  return { target, yaw: 0.8 * Math.atan2(normal[0], normal[2]), pitch: Math.max(-0.5, Math.min(0.5, 0.6 * steep)) };
}

/** @param {Float32Array} p @param {Uint32Array} indices @param {Vector} place @param {number} radius @returns {Vector} */
function normalAround(p, indices, place, radius) {
  const sum = [0, 0, 0];
  for (let t = 0; t < indices.length; t += 3) {
    const [i, j, k] = [3 * indices[t], 3 * indices[t + 1], 3 * indices[t + 2]];
    if (Math.hypot(p[i] - place[0], p[i + 1] - place[1], p[i + 2] - place[2]) > radius) continue;
    const [ax, ay, az] = [p[j] - p[i], p[j + 1] - p[i + 1], p[j + 2] - p[i + 2]];
    const [bx, by, bz] = [p[k] - p[i], p[k + 1] - p[i + 1], p[k + 2] - p[i + 2]];
    const facing = ax * by - ay * bx;
    if (facing <= 0) continue; // inside of a mouth, or the back of an eye
    sum[0] += ay * bz - az * by;
    sum[1] += az * bx - ax * bz;
    sum[2] += facing;
  }
  const length = Math.hypot(...sum);
  return length > 0 ? /** @type {Vector} */ (sum.map((value) => value / length)) : [0, 0, 1];
}
