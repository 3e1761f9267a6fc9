// Asks what dropped files are for, and how large the maps of a new asset are.

import { byId, make } from "./dom.js";
import { purposeOf } from "./dropped.js";

/**
 * @typedef {import('./dropped.js').Purpose} Purpose
 * @typedef {{mesh: File, shapes: File | null, settings: Record<string, unknown>}} Upload
 */

const WORDS = { mesh: "Mesh of a new asset", shapes: "Its shapes", weights: "Weights to play", nothing: "Leave out" };

export class FilesDialog {
  /**
   * @param {(upload: Upload) => void} build
   * @param {(file: File) => void} play
   */
  constructor(build, play) {
    this.build = build;
    this.play = play;
    this.dialog = byId("files-dialog", HTMLDialogElement);
    this.wrong = byId("files-wrong", HTMLParagraphElement);
    /** @type {{file: File, select: HTMLSelectElement}[]} */
    this.rows = [];
    byId("files-cancel", HTMLButtonElement).addEventListener("click", () => this.dialog.close());
    byId("files-use", HTMLButtonElement).addEventListener("click", (event) => {
      event.preventDefault();
      this.use();
    });
  }

  /**
   * Play a file of weights at once; ask about others.
   * @param {File[]} files
   * @param {boolean} canBuild whether there is a service
   * @throws {Error} where none of them can be used
   */
  async take(files, canBuild) {
    const found = await Promise.all(files.map(async (file) => ({ file, ...(await purposeOf(file)) })));
    const plain = found.every(({ purpose }) => purpose === "weights" || purpose === "nothing");
    const weights = found.find(({ purpose, also }) => purpose === "weights" || also.includes("weights"));
    if (plain || !canBuild) {
      if (!weights) throw new Error(`${files.map((file) => file.name).join(", ")}: no weights, and no mesh that can be sent`);
      this.play(weights.file);
      return;
    }
    this.rows = found.map(({ file, purpose, also }) => {
      /** @type {Purpose[]} */
      const offered = [...new Set([purpose, ...also, /** @type {Purpose} */ ("nothing")])];
      const options = offered.map((one) => make("option", { value: one }, [WORDS[one]]));
      return { file, select: make("select", { "aria-label": file.name }, options) };
    });
    const lines = this.rows.map(({ file, select }) => make("label", {}, [make("span", {}, [file.name]), select]));
    byId("files-list", HTMLDivElement).replaceChildren(...lines);
    this.wrong.hidden = true;
    this.dialog.showModal();
  }

  use() {
    const of = (/** @type {Purpose} */ purpose) => this.rows.filter((row) => row.select.value === purpose).map((row) => row.file);
    const [meshes, shapes, weights] = [of("mesh"), of("shapes"), of("weights")];
    if (meshes.length > 1 || shapes.length > 1 || (shapes.length && !meshes.length) || meshes.length + weights.length === 0) {
      this.wrong.textContent = "One mesh, and one file of its shapes at most.";
      this.wrong.hidden = false;
      return;
    }
    this.dialog.close();
    const resolution = Number(byId("files-resolution", HTMLSelectElement).value);
    const unit = byId("files-unit", HTMLSelectElement).value;
    const settings = { resolution, ...(unit ? { unit } : {}) };
    if (meshes.length) this.build({ mesh: meshes[0], shapes: shapes[0] ?? null, settings });
    else this.play(weights[0]);
  }
}
