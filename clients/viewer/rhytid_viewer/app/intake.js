// Files that are dropped or chosen: weights to play, and meshes for the service.

import { byId } from "./dom.js";
import { addDrop } from "./dropped.js";
import { FilesDialog } from "./files_dialog.js";
import { banner, reason } from "./messages.js";

/**
 * @param {import('./page.js').Page} page
 * @param {((upload: import('./files_dialog.js').Upload, signal: AbortSignal) => Promise<void>) | null} build
 *   sends a mesh; null without a service
 */
export function addIntake(page, build) {
  const told = (/** @type {unknown} */ error) => banner(reason(error), { stays: true });
  const play = async (/** @type {File} */ file) => {
    if (!page.face) throw new Error(`${file.name}: weights move a face, and there is none yet`);
    await page.player.open(file);
  };
  const dialog = new FilesDialog(async (upload, signal) => build?.(upload, signal), play);
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
