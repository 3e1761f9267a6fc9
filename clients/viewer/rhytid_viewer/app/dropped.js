// What dropped files are for.

import { openNpz } from "./npy.js";

/** @typedef {'mesh' | 'shapes' | 'weights' | 'nothing'} Purpose */

const MESHES = [".obj", ".ply", ".gltf", ".glb"];

/**
 * What a file is for, by its name and, of a .npz, by the arrays in it.
 * @param {File} file
 * @returns {Promise<{purpose: Purpose, also: Purpose[]}>} also: what it may be used for instead
 */
export async function purposeOf(file) {
  const ending = file.name.slice(file.name.lastIndexOf(".")).toLowerCase();
  if (MESHES.includes(ending)) return only("mesh");
  if (ending === ".json" || ending === ".csv") return only("weights");
  if (ending === ".npy") return { purpose: "weights", also: ["shapes"] };
  if (ending !== ".npz") return only("nothing");
  const names = await membersOf(file);
  const mesh = names.has("faces");
  const weights = names.has("weights");
  if (mesh) return { purpose: "mesh", also: weights ? ["weights", "shapes"] : ["shapes"] };
  if (weights) return { purpose: "weights", also: [] };
  return { purpose: names.has("shapes") || names.has("frames") ? "shapes" : "nothing", also: [] };
}

/** @param {File} file @throws {Error} that names the file */
async function membersOf(file) {
  try {
    return openNpz(await file.arrayBuffer());
  } catch (error) {
    throw new Error(`${file.name}: ${error instanceof Error ? error.message : error}`, { cause: error });
  }
}

/** @param {Purpose} purpose @returns {{purpose: Purpose, also: Purpose[]}} */
function only(purpose) {
  return { purpose, also: [] };
}

/**
 * Let files be dropped anywhere.
 * @param {(files: File[]) => void} take
 */
export function addDrop(take) {
  const within = (/** @type {DragEvent} */ event) => event.dataTransfer?.types.includes("Files");
  window.addEventListener("dragover", (event) => {
    if (!within(event)) return;
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  window.addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) document.body.classList.remove("dropping");
  });
  window.addEventListener("drop", (event) => {
    document.body.classList.remove("dropping");
    if (!within(event)) return;
    event.preventDefault();
    take([...(event.dataTransfer?.files ?? [])]);
  });
}
