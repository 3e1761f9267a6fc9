// Asks what dropped files are for, and how large the maps of a new asset are.

import { byId, make } from "./dom.js";
import { purposeOf } from "./dropped.js";
import { reason } from "./messages.js";

/**
 * @typedef {import('./dropped.js').Purpose} Purpose
 * @typedef {{mesh: File, shapes: File | null, settings: Record<string, unknown>}} Upload
 */

const WORDS = { mesh: "Mesh of a new asset", shapes: "Its shapes", weights: "Weights to play", nothing: "Leave out" };

export class FilesDialog {
  /**
   * @param {(upload: Upload, signal: AbortSignal) => Promise<void>} build done when the service has taken it
   * @param {(file: File) => Promise<void>} play
   */
  constructor(build, play) {
    this.build = build;
    this.play = play;
    this.dialog = byId("files-dialog", HTMLDialogElement);
    this.wrong = byId("files-wrong", HTMLParagraphElement);
    /** @type {{file: File, select: HTMLSelectElement}[]} */
    this.rows = [];
    this.button = byId("files-use", HTMLButtonElement);
    /** Ends what is being sent. */
    this.sending = new AbortController();
    byId("files-cancel", HTMLButtonElement).addEventListener("click", () => this.dialog.close());
    this.dialog.addEventListener("close", () => this.sending.abort());
    this.button.addEventListener("click", (event) => {
      event.preventDefault();
      void this.use();
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
      await this.play(weights.file);
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
    this.tell(null);
    if (!this.dialog.open) this.dialog.showModal();
  }

  /** Do what is asked for. Where that fails the dialog stays, with the files and the reason. */
  async use() {
    const of = (/** @type {Purpose} */ purpose) => this.rows.filter((row) => row.select.value === purpose).map((row) => row.file);
    const [meshes, shapes, weights] = [of("mesh"), of("shapes"), of("weights")];
    if (meshes.length > 1 || shapes.length > 1 || (shapes.length && !meshes.length) || meshes.length + weights.length === 0) {
      this.tell("One mesh, and one file of its shapes at most.");
      return;
    }
    const resolution = Number(byId("files-resolution", HTMLSelectElement).value);
    const unit = byId("files-unit", HTMLSelectElement).value;
    const settings = { resolution, ...(unit ? { unit } : {}) };
    const sending = (this.sending = new AbortController());
    this.tell(null);
    this.button.disabled = true;
    this.button.textContent = meshes.length ? "Sending…" : "Reading…";
    try {
      if (meshes.length) await this.build({ mesh: meshes[0], shapes: shapes[0] ?? null, settings }, sending.signal);
      else await this.play(weights[0]);
      if (sending === this.sending) this.dialog.close();
    } catch (error) {
      if (!sending.signal.aborted) this.tell(reason(error));
    } finally {
      this.button.disabled = false;
      this.button.textContent = "Build";
    }
  }

  /** @param {string | null} text what is wrong */
  tell(text) {
    this.wrong.textContent = text;
    this.wrong.hidden = text === null;
  }
}
