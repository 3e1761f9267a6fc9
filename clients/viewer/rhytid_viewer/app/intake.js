// Files that are dropped or chosen: weights to play, and meshes for the service.

import { byId } from "./dom.js";
import { addDrop } from "./dropped.js";
import { FilesDialog } from "./files_dialog.js";
import { banner, reason } from "./messages.js";

/**
 * @param {import('./page.js').Page} page
 * @param {((upload: import('./files_dialog.js').Upload) => Promise<void>) | null} build sends a mesh;
 *   null without a service
 */
export function addIntake(page, build) {
  const told = (/** @type {unknown} */ error) => banner(reason(error), { stays: true });
  const play = (/** @type {File} */ file) => {
    if (page.face) page.player.open(file).catch(told);
    else banner("Weights move a face: there is none yet.");
  };
  const dialog = new FilesDialog((upload) => void build?.(upload).catch(told), play);
  const take = (/** @type {File[]} */ files) => {
    banner(null);
    if (files.length) dialog.take(files, build !== null).catch(told);
  };
  addDrop(take);
  addChooser("clip-open", "clip-file", take);
  if (build) addChooser("upload-open", "upload-file", take);
}

/** @param {string} button @param {string} input @param {(files: File[]) => void} take */
function addChooser(button, input, take) {
  const field = byId(input, HTMLInputElement);
  byId(button, HTMLButtonElement).addEventListener("click", () => field.click());
  field.addEventListener("change", () => {
    take([...(field.files ?? [])]);
    field.value = "";
  });
}
