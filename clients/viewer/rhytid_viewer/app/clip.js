// Weights of shapes over time: read from files, or the sweep that is built in.

import { openNpz, readNpy } from "./npy.js";
import { meantShapes } from "./shape_names.js";
import { weightOf } from "./state.js";

/**
 * @typedef {object} Clip
 * @property {string} title
 * @property {string[]} names of the weights
 * @property {number} fps
 * @property {ArrayLike<number>[]} frames the weights of each
 */

const FPS = 30;

/**
 * Read weights: .json, .csv of Live Link Face, .npy or .npz.
 * @param {File} file
 * @param {readonly string[]} shapes of the face; names of the columns where a file has none
 * @returns {Promise<Clip>}
 * @throws {Error} that names the file and what is wrong with it
 */
export async function readClip(file, shapes) {
  try {
    const found = await parsed(file, shapes);
    check(found, shapes);
    return found;
  } catch (error) {
    throw new Error(`${file.name}: ${error instanceof Error ? error.message : error}`, { cause: error });
  }
}

/** @param {File} file @param {readonly string[]} shapes @returns {Promise<Clip>} */
async function parsed(file, shapes) {
  const ending = file.name.slice(file.name.lastIndexOf(".")).toLowerCase();
  const title = file.name;
  if (ending === ".json") return { title, ...ofJson(JSON.parse(await file.text())) };
  if (ending === ".csv") return { title, ...ofCsv(await file.text()) };
  if (ending === ".npy") {
    return { title, names: [...shapes], fps: FPS, frames: rows(readNpy(await file.arrayBuffer())) };
  }
  const members = openNpz(await file.arrayBuffer());
  const [weights, names, fps] = await Promise.all(["weights", "names", "fps"].map((name) => members.get(name)?.()));
  if (!weights) throw new Error("there is no array 'weights' in it");
  return {
    title,
    names: names ? /** @type {string[]} */ (names.values) : [...shapes],
    fps: fps ? Number(fps.values[0]) : FPS,
    frames: rows(weights),
  };
}

/** @param {import('./npy.js').NumpyArray} array */
function rows({ shape, values }) {
  if (shape.length !== 2) throw new Error(`weights have the shape (${shape.join(", ")}): must be (frames, shapes)`);
  const numbers = Float32Array.from(/** @type {Float32Array} */ (values));
  return Array.from({ length: shape[0] }, (_, row) => numbers.subarray(row * shape[1], (row + 1) * shape[1]));
}

/**
 * Either {names, weights or frames, fps}, or a list of frames as {name: weight}, or poses by their
 * names as {pose: {name: weight}}.
 * @param {any} value
 */
function ofJson(value) {
  if (Array.isArray(value?.names)) {
    const frames = value.weights ?? value.frames;
    if (!Array.isArray(frames)) throw new Error("there is no list 'weights' in it");
    return { names: value.names.map(String), fps: Number(value.fps ?? FPS), frames };
  }
  const poses = Array.isArray(value) ? value : eased(Object.values(value ?? {}));
  const names = [...new Set(poses.flatMap((pose) => Object.keys(pose ?? {})))];
  return { names, fps: FPS, frames: poses.map((pose) => names.map((name) => Number(weightOf(pose ?? {}, name) ?? 0))) };
}

/** Every pose for two seconds, from rest and back. @param {Record<string, number>[]} poses */
function eased(poses) {
  return poses.flatMap((pose) =>
    Array.from({ length: 2 * FPS }, (_, frame) => {
      const share = Math.sin((Math.PI * frame) / (2 * FPS)) ** 2;
      return Object.fromEntries(Object.entries(pose).map(([name, weight]) => [name, weight * share]));
    }),
  );
}

/** @param {string} text the first line has the names */
function ofCsv(text) {
  const [head, ...lines] = text.trim().split(/\r?\n/);
  const names = head.split(",").map((name) => name.trim());
  // A recording of Live Link Face has the time of each frame first, and how many weights follow.
  const used = names.map((_, index) => index).filter((index) => !/^(timecode|blendshapecount|frame|time)$/i.test(names[index]));
  const frames = lines.filter(Boolean).map((line) => {
    const cells = line.split(",");
    return used.map((index) => Number(cells[index] ?? NaN));
  });
  return { names: used.map((index) => names[index]), fps: FPS, frames };
}

/** @param {Clip} clip @param {readonly string[]} shapes */
function check(clip, shapes) {
  if (!clip.frames.length) throw new Error("it has no frames");
  if (!(clip.fps > 0)) throw new Error(`fps is ${clip.fps}: must be above 0`);
  clip.frames.forEach((frame, index) => {
    if (frame.length !== clip.names.length) {
      throw new Error(`frame ${index} has ${frame.length} weights for ${clip.names.length} names`);
    }
    const wrong = Array.from(frame).findIndex((weight) => !Number.isFinite(weight));
    if (wrong >= 0) throw new Error(`frame ${index} has no number for ${clip.names[wrong]}`);
  });
  if (!meantShapes(clip.names, shapes).some((found) => found.length)) {
    throw new Error(`the face has none of its shapes: ${clip.names.slice(0, 6).join(", ")}, …`);
  }
}

/**
 * Every shape in turn, up and down, each beginning while the one before ends.
 * @param {readonly string[]} shapes
 * @returns {Clip}
 */
export function sweep(shapes) {
  const [each, apart] = [1.6 * FPS, 1.1 * FPS];
  const count = Math.ceil(apart * (shapes.length - 1) + each) + 1;
  const frames = Array.from({ length: count }, (_, frame) =>
    Float32Array.from(shapes, (_name, index) => {
      const at = (frame - index * apart) / each;
      return at > 0 && at < 1 ? Math.sin(Math.PI * at) ** 2 : 0;
    }),
  );
  return { title: "Sweep through the shapes", names: [...shapes], fps: FPS, frames };
}

/**
 * The weights of a face at a time, between frames in proportion.
 * @param {Clip} clip
 * @param {readonly string[]} shapes
 * @returns {(seconds: number) => Record<string, number>} those that are not 0
 */
export function sampler(clip, shapes) {
  const meant = meantShapes(clip.names, shapes);
  return (seconds) => {
    const at = Math.min(Math.max(seconds * clip.fps, 0), clip.frames.length - 1);
    const [before, after] = [clip.frames[Math.floor(at)], clip.frames[Math.ceil(at)]];
    const share = at - Math.floor(at);
    /** @type {Map<string, number>} */
    const found = new Map();
    meant.forEach((indices, column) => {
      const weight = before[column] + share * (after[column] - before[column]);
      for (const index of weight ? indices : []) {
        found.set(shapes[index], (found.get(shapes[index]) ?? 0) + weight);
      }
    });
    return Object.fromEntries(found);
  };
}

/** Seconds from the first frame to the last. @param {Clip} clip */
export function duration(clip) {
  return (clip.frames.length - 1) / clip.fps;
}
