// A face that is shown: its view, kept in step with the state of the page.

import { SkinView } from "../view/skin_view.js";
import { afterQuiet, byId, oncePerPicture } from "./dom.js";
import { showProbe } from "./probe_line.js";
import { weightOf } from "./state.js";
import { FIRST, viewsOf } from "./views.js";

/**
 * @typedef {import('./state.js').State} State
 * @typedef {import('./address.js').Place} Place
 * @typedef {object} Told
 * @property {() => void} drawn a picture is there
 * @property {() => void} moved the camera is elsewhere
 * @property {() => void} posed another pose is set
 * @property {ExactAt} exactAt
 * @property {() => void} lost the graphics are lost: nothing is drawn from now on
 * @property {() => void} restored there are graphics again, without anything of this face
 * @property {(error: unknown) => void} failed nothing can be drawn
 *
 * @typedef {(udim: number, texel: readonly [number, number]) => {height: number, level: number} | null} ExactAt
 */

// Pictures further apart than so many milliseconds are no movement.
const STILL = 300;
const QUIET = 120;
// Of so many pictures, in no more than so many milliseconds, a rate is told.
const FEWEST = 10;
const RUN = 3000;
// More pixels than these a CSS pixel are not seen, and cost.
const DENSEST = 2;

export class Face {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import('../view/types.js').SkinPackage} skin
   * @param {import('./state.js').Store} store
   * @param {Told} told
   * @throws {import('../view/skin_view.js').Unsupported}
   */
  constructor(canvas, skin, store, told) {
    this.canvas = canvas;
    this.skin = skin;
    this.store = store;
    this.told = told;
    this.view = new SkinView(canvas, skin);
    // They are on the GPU; if they are lost there the package is read again.
    skin.textures.clear();
    this.views = viewsOf(skin.mesh, this.view.camera.fov);
    /** Where it is looked at from at first. */
    this.home = (this.views.find(({ name }) => name === FIRST) ?? this.views[0]).place;
    Object.assign(this.view.camera, { ...this.home, target: [...this.home.target] });
    this.gone = false;
    /** Pictures a second while something moves, 0 while nothing does. */
    this.rate = 0;
    this.drawnAt = 0;
    /** Pictures that followed each other, and when the first of them was. */
    this.run = { count: 0, since: 0 };
    this.redraw = oncePerPicture(() => this.draw());
    /** Where the pointer is, CSS pixels in the canvas. @type {[number, number] | null} */
    this.pointer = null;
    this.probeSoon = oncePerPicture(() => this.probe());
    // Reading a height back waits for the picture: not while pictures follow each other.
    this.probeLater = afterQuiet(QUIET, () => this.probe());
    canvas.addEventListener("webglcontextlost", (event) => this.lost(event));
    canvas.addEventListener("webglcontextrestored", () => told.restored());
    this.sizes = new ResizeObserver(() => this.fit());
    this.sizes.observe(byId("picture-area", HTMLElement));
    this.pose(store.state);
    this.options(store.state);
    this.fit();
  }

  get shapes() {
    return this.skin.mesh.shapes.map((shape) => shape.name);
  }

  /** @param {State} state @param {ReadonlySet<keyof State>} changed */
  follow(state, changed) {
    if (changed.has("weights")) this.pose(state);
    this.options(state);
    this.redraw();
  }

  /** @param {State} state */
  pose(state) {
    this.view.setWeights(Float32Array.from(this.shapes, (name) => weightOf(state.weights, name)));
    this.told.posed();
  }

  /** @param {State} state */
  options({ method, strength, colours, axes, split, light }) {
    this.view.setOptions({ method, strength, colours, axes, split, light });
  }

  fit() {
    const { clientWidth, clientHeight } = this.canvas;
    const density = Math.min(window.devicePixelRatio || 1, DENSEST);
    const [width, height] = [clientWidth, clientHeight].map((side) => Math.max(1, Math.round(side * density)));
    if (this.canvas.width !== width || this.canvas.height !== height) {
      Object.assign(this.canvas, { width, height });
      this.told.moved();
    }
    this.redraw();
  }

  draw() {
    if (this.gone) return;
    try {
      this.view.draw();
    } catch (error) {
      this.gone = true;
      this.told.failed(error);
      return;
    }
    this.probeLater();
    this.count(performance.now());
    this.told.drawn();
  }

  /** Count a picture. @param {number} now milliseconds */
  count(now) {
    if (now - this.drawnAt > STILL) this.run = { count: 0, since: now };
    else this.run.count += 1;
    this.drawnAt = now;
    this.rate = this.run.count < FEWEST ? 0 : (1000 * this.run.count) / (now - this.run.since);
    if (now - this.run.since > RUN) this.run = { count: FEWEST, since: now - (1000 * FEWEST) / (this.rate || 1) };
  }

  /** Do something with the camera. @param {(camera: SkinView["camera"]) => void} change */
  move(change) {
    change(this.view.camera);
    this.told.moved();
    this.redraw();
  }

  /** @returns {Place} */
  place() {
    const { target, distance, yaw, pitch, fov } = this.view.camera;
    return { target: [...target], distance, yaw, pitch, fov };
  }

  /** @param {Place} place */
  moveTo({ target, ...others }) {
    this.move((camera) => Object.assign(camera, { ...others, target: [...target] }));
  }

  /** Look at what lies there. @param {number} x @param {number} y CSS pixels in the canvas */
  centre(x, y) {
    const found = this.view.probe(x, y);
    if (!found) return;
    const { centre } = this.skin.manifest.mesh;
    const [px, py, pz] = found.position.map((value, axis) => value - centre[axis]);
    this.move((camera) => (camera.target = [px, py, pz]));
  }

  /** @param {number} x @param {number} y CSS pixels in the canvas */
  pointAt(x, y) {
    this.pointer = [x, y];
    this.probeSoon();
  }

  probe() {
    if (this.gone || !this.pointer) return;
    const found = this.view.probe(...this.pointer);
    const exact = found && this.told.exactAt(found.udim, found.texel);
    if (found && exact) found.displacement = exact.height;
    showProbe(found, this.skin.manifest, exact?.level ?? 0);
  }

  /** Save the picture as a file. */
  async save() {
    const blob = await this.view.picture();
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `rhytid-${this.skin.manifest.asset}-${this.store.state.method}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  /** @param {Event} event */
  lost(event) {
    if (this.gone) return;
    event.preventDefault(); // else it is never restored
    this.gone = true;
    this.told.lost();
  }

  dispose() {
    this.gone = true;
    this.sizes.disconnect();
    this.view.dispose();
  }
}
