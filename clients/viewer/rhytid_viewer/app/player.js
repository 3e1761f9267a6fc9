// Plays a clip of weights.

import { byId } from "./dom.js";
import { duration, readClip, sampler, sweep } from "./clip.js";

export class Player {
  /** @param {import('./state.js').Store} store */
  constructor(store) {
    this.store = store;
    this.button = byId("play", HTMLButtonElement);
    this.time = byId("time", HTMLInputElement);
    this.toSweep = byId("clip-sweep", HTMLButtonElement);
    this.playing = false;
    /** When second 0 of the clip was, in milliseconds of the page. */
    this.begun = 0;
    /** @type {readonly string[]} */
    this.shapes = [];
    this.use(sweep([]));
    this.button.addEventListener("click", () => this.toggle());
    this.time.addEventListener("input", () => {
      this.pause();
      this.show(this.time.valueAsNumber);
    });
    this.toSweep.addEventListener("click", () => this.use(sweep(this.shapes)));
  }

  /** @param {readonly string[]} shapes of another face */
  face(shapes) {
    this.shapes = shapes;
    this.use(sweep(shapes));
  }

  /**
   * Take a file of weights and play it.
   * @param {File} file
   * @throws {Error} that names the file and what is wrong with it
   */
  async open(file) {
    this.use(await readClip(file, this.shapes));
    this.toggle();
  }

  /** @param {import('./clip.js').Clip} clip */
  use(clip) {
    this.pause();
    this.clip = clip;
    this.sample = sampler(clip, this.shapes);
    this.time.max = String(duration(clip));
    this.time.valueAsNumber = 0;
    this.toSweep.hidden = clip.title === sweep([]).title;
    const nothing = !this.shapes.length;
    const title = nothing ? "" : `${clip.title}, ${clip.frames.length} frames`;
    byId("clip-name", HTMLParagraphElement).textContent = title;
    byId("time-value", HTMLOutputElement).value = "0.0 s";
    this.button.disabled = nothing;
    this.time.disabled = nothing;
  }

  toggle() {
    if (this.playing) {
      this.pause();
    } else if (this.shapes.length) {
      this.playing = true;
      this.begun = performance.now() - 1000 * this.time.valueAsNumber;
      requestAnimationFrame((now) => this.step(now));
    }
    this.showButton();
  }

  pause() {
    this.playing = false;
    this.showButton();
  }

  showButton() {
    this.button.textContent = this.playing ? "Pause" : "Play";
    this.button.setAttribute("aria-pressed", String(this.playing));
  }

  /** @param {number} now milliseconds of the page */
  step(now) {
    if (!this.playing || !this.clip) return;
    const length = Math.max(duration(this.clip), 1e-6);
    this.show((Math.max(0, now - this.begun) / 1000) % length);
    requestAnimationFrame((later) => this.step(later));
  }

  /** @param {number} seconds */
  show(seconds) {
    this.time.valueAsNumber = seconds;
    byId("time-value", HTMLOutputElement).value = `${seconds.toFixed(1)} s`;
    if (this.sample) this.store.set({ weights: this.sample(seconds) });
  }
}
