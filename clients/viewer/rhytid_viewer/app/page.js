// Puts the page together: one state, the controls that change it, the face that shows it.

import { SkinView, Unsupported } from "../view/skin_view.js";
import { loadPackage } from "../view/package.js";
import * as address from "./address.js";
import { addDivider } from "./divider.js";
import { afterQuiet, byId, megabytes } from "./dom.js";
import { Face } from "./face.js";
import { Light } from "./light.js";
import { LookPanel } from "./look_panel.js";
import { addKeyboard } from "./keyboard.js";
import { banner, message, reason } from "./messages.js";
import { Player } from "./player.js";
import { addPointer } from "./pointer.js";
import { ShapesPanel } from "./shapes_panel.js";
import { LIGHT, Store } from "./state.js";

const REMEDY = "Turn on hardware acceleration in its settings, or take a current Chrome, Edge, Firefox or Safari.";

/**
 * @typedef {object} Told what the page tells whoever has tiles to bring
 * @property {(face: Face) => void} shown another face is shown
 * @property {() => void} posed
 * @property {() => void} moved
 * @property {import('./face.js').ExactAt} exactAt
 */

export class Page {
  constructor() {
    this.canvas = byId("canvas", HTMLCanvasElement);
    /** Whether there is a service for exact tiles. */
    this.exactAllowed = true;
    /** Whether the key of the light is held. */
    this.lightKey = () => false;
    this.store = new Store();
    /** @type {Face | null} */
    this.face = null;
    /** @type {Told} */
    this.told = { shown() {}, posed() {}, moved() {}, exactAt: () => null };
    /** What the service has to say at the end of the status. */
    this.note = "";
    this.player = new Player(this.store);
    this.shapes = new ShapesPanel(this.store, () => this.player.pause());
    this.light = new Light(this.store, () => this.face?.view.camera ?? null);
    this.look = new LookPanel(this.store, SkinView.legend());
    addDivider(this.store, byId("stage", HTMLElement));
    this.writeSoon = afterQuiet(250, () => this.writeAddress());
    this.store.listen((state, changed) => {
      this.face?.follow(state, changed);
      this.writeSoon();
    });
    addControls(this);
    addGestures(this);
    window.addEventListener("hashchange", () => this.readAddress());
  }

  /**
   * Load a package and show it; the one before stays until then.
   * @param {import('../view/types.js').Read} read
   * @param {import('./address.js').Place | null} place of the camera, else as it looks at first
   */
  async show(read, place) {
    const skin = await loadPackage(read, ({ file, bytes, files, of }) => {
      message("Loading the skin", `${file}, ${megabytes(bytes)}`, of ? files / of : 0);
    });
    this.face?.dispose();
    this.face = null;
    this.freshCanvas();
    this.face = new Face(this.canvas, skin, this.store, {
      drawn: () => this.showStatus(),
      posed: () => this.told.posed(),
      exactAt: (udim, texel) => this.told.exactAt(udim, texel),
      moved: () => {
        this.told.moved();
        this.light.show();
        this.writeSoon();
      },
    });
    message(null);
    this.shapes.fill(this.face.shapes);
    this.player.face(this.face.shapes);
    if (place) this.face.moveTo(place);
    this.light.show();
    this.told.shown(this.face);
    this.face.redraw();
  }

  /** A canvas has one context in its life: another face gets another canvas. */
  freshCanvas() {
    const next = /** @type {HTMLCanvasElement} */ (this.canvas.cloneNode());
    this.canvas.replaceWith(next);
    this.canvas = next;
    addGestures(this);
  }

  /** There is no service: exact tiles cannot be had. */
  withoutService() {
    this.exactAllowed = false;
    this.look.allowExact(false);
  }

  /** What the address says; a face is looked for by who has some. */
  readAddress() {
    const { state, camera } = address.read(location.hash);
    const { asset, ...others } = state;
    this.player.pause();
    this.store.set(others);
    if (this.face) this.face.moveTo(camera ?? this.face.home);
    return { asset, camera };
  }

  writeAddress() {
    if (!this.face) return;
    const text = address.written(this.store.state, this.face.place());
    if (`#${text}` !== location.hash) history.replaceState(null, "", `#${text}`);
  }

  resetView() {
    this.store.set({ light: [...LIGHT] });
    if (this.face) this.face.moveTo(this.face.home);
  }

  showStatus() {
    if (!this.face) return;
    const { manifest } = this.face.skin;
    const { textureBytes, stretchMilliseconds } = this.face.view.statistics();
    const parts = [
      `${manifest.stretch.triangles.toLocaleString("en")} triangles`,
      `${manifest.resolution}²`,
      `${megabytes(textureBytes)} of textures`,
      `stretch ${stretchMilliseconds.toFixed(1)} ms`,
      this.face.rate ? `${this.face.rate.toFixed(0)} pictures/s` : "",
      this.note,
    ];
    byId("status", HTMLParagraphElement).textContent = parts.filter(Boolean).join(" · ");
  }

  /** Show why there is no face. @param {unknown} error */
  failed(error) {
    const unsupported = error instanceof Unsupported;
    const text = unsupported ? "This browser cannot show the skin." : "The skin could not be loaded.";
    const detail = unsupported ? `${reason(error)} ${REMEDY}` : reason(error);
    if (this.face) banner(`${text} ${detail}`, { stays: true });
    else message(text, detail);
  }
}

/** @param {Page} page */
function addControls(page) {
  const { store, player } = page;
  const panel = byId("panel-toggle", HTMLButtonElement);
  const help = byId("help-dialog", HTMLDialogElement);
  const picture = () => page.face?.save().catch((error) => banner(`No picture: ${reason(error)}`));
  const togglePanel = () => {
    const hidden = document.body.classList.toggle("no-panel");
    panel.setAttribute("aria-expanded", String(!hidden));
  };
  byId("picture", HTMLButtonElement).addEventListener("click", picture);
  byId("help", HTMLButtonElement).addEventListener("click", () => help.showModal());
  byId("help-close", HTMLButtonElement).addEventListener("click", () => help.close());
  byId("view-reset", HTMLButtonElement).addEventListener("click", () => page.resetView());
  panel.addEventListener("click", togglePanel);

  const turn = (/** @type {number} */ dx, /** @type {number} */ dy) => page.light.turn(0.008 * dx, 0.008 * dy);
  page.lightKey = addKeyboard(
    {
      orbit: (dx, dy) => page.face?.move((camera) => camera.orbit(dx, dy)),
      pan: (dx, dy) => page.face?.move((camera) => camera.pan(dx, dy)),
      zoom: (factor) => page.face?.move((camera) => camera.zoom(factor)),
      light: turn,
    },
    {
      1: { does: "Neutral skin", run: () => store.set({ method: "neutral" }) },
      2: { does: "Fast skin", run: () => store.set({ method: "fast" }) },
      3: { does: "Exact skin, of a service", run: () => page.exactAllowed && store.set({ method: "exact" }) },
      c: { does: "Stretch colours", run: () => store.set({ colours: store.state.colours === "skin" ? "stretch" : "skin" }) },
      x: { does: "Principal axes", run: () => store.set({ axes: !store.state.axes }) },
      s: { does: "Split with neutral", run: () => store.set({ split: store.state.split === null ? 0.5 : null }) },
      " ": { does: "Play, pause", run: () => player.toggle() },
      r: { does: "Reset camera and light", run: () => page.resetView() },
      0: { does: "All weights to 0", run: () => page.shapes.reset() },
      f: { does: "Filter shapes", run: () => page.shapes.filter.focus() },
      p: { does: "Save the picture", run: picture },
      h: { does: "This list", run: () => help.showModal() },
    },
  );
}

/** @param {Page} page */
function addGestures(page) {
  const turn = (/** @type {number} */ dx, /** @type {number} */ dy) => page.light.turn(0.008 * dx, 0.008 * dy);
  addPointer(page.canvas, {
    orbit: (dx, dy) => page.face?.move((camera) => camera.orbit(dx, dy)),
    pan: (dx, dy) => page.face?.move((camera) => camera.pan(dx, dy)),
    zoom: (factor, x, y) => page.face?.move((camera) => camera.zoom(factor, x, y)),
    light: turn,
    probe: (x, y) => page.face?.pointAt(x, y),
    centre: (x, y) => page.face?.centre(x, y),
    lightKey: page.lightKey,
  });
}
