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
import { ViewsBar } from "./views.js";

const REMEDY = "Turn on hardware acceleration in its settings, or take a current Chrome, Edge, Firefox or Safari.";

/**
 * @typedef {object} Told what the page tells whoever has tiles to bring
 * @property {(face: Face, asset: string | null) => void} shown another face is shown
 * @property {() => void} lost the graphics of the face are lost
 * @property {(asset: string, place: import('./address.js').Place | null) => void} restore there are graphics again: load it anew
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
    this.told = { shown() {}, posed() {}, moved() {}, lost() {}, restore() {}, exactAt: () => null };
    /** What the service has to say at the end of the status. */
    this.note = "";
    this.player = new Player(this.store);
    this.shapes = new ShapesPanel(this.store, () => this.player.pause());
    this.light = new Light(this.store, () => this.face?.view.camera ?? null);
    this.look = new LookPanel(this.store, SkinView.legend());
    this.views = new ViewsBar((place) => this.face?.moveTo(place));
    addDivider(this.store, byId("stage", HTMLElement));
    this.writeSoon = afterQuiet(250, () => this.writeAddress());
    this.store.listen((state, changed) => {
      this.face?.follow(state, changed);
      this.writeSoon();
    });
    addControls(this);
    addGestures(this);
    window.addEventListener("hashchange", ({ newURL }) => this.readAddress(new URL(newURL).hash));
  }

  /**
   * Load a package and show it; the one before stays until then, and where this one fails.
   * @param {import('../view/types.js').Read} read
   * @param {import('./address.js').Place | null} place of the camera, else as it looks at first
   * @param {{asset?: string | null, signal?: AbortSignal}} [options] asset: its id, in a service; signal:
   *   aborted where another one is to be shown
   * @throws {unknown} the reason of the signal too
   */
  async show(read, place, { asset = null, signal } = {}) {
    signal?.throwIfAborted();
    const skin = await loadPackage(read, ({ file, bytes, files, of }) => {
      if (!signal?.aborted) message("Loading the skin", `${file}, ${megabytes(bytes)}`, of ? files / of : 0);
    });
    signal?.throwIfAborted();
    const before = this.store.state.asset;
    const face = this.newFace(skin, () => this.restore(read, asset));
    if (before !== null && before !== asset) this.store.set({ weights: {} });
    this.store.set({ asset });
    this.face = face;
    message(null);
    banner(null);
    this.shapes.fill(this.face.shapes);
    this.player.face(this.face.shapes);
    this.views.fill(this.face.views);
    if (place) this.face.moveTo(place);
    this.light.show();
    this.told.shown(this.face, asset);
    this.face.redraw();
  }

  /**
   * A face in place of the one before, which stays where this one cannot be made. A canvas has one
   * context in its life: another face gets another canvas.
   * @param {import('../view/types.js').SkinPackage} skin
   * @param {() => void} restored the graphics are back after they were lost
   */
  newFace(skin, restored) {
    const before = this.canvas;
    this.canvas = /** @type {HTMLCanvasElement} */ (before.cloneNode());
    before.replaceWith(this.canvas);
    try {
      /** @type {Face} */
      const face = new Face(this.canvas, skin, this.store, {
        ...this.toldByFace(),
        restored: () => this.face === face && restored(),
      });
      this.face?.dispose();
      this.face = null;
      addGestures(this);
      return face;
    } catch (error) {
      this.canvas.replaceWith(before);
      this.canvas = before;
      throw error;
    }
  }

  /** What a face tells. */
  toldByFace() {
    return {
      drawn: () => this.showStatus(),
      posed: () => this.told.posed(),
      exactAt: (/** @type {Parameters<import('./face.js').ExactAt>} */ ...at) => this.told.exactAt(...at),
      moved: () => {
        this.told.moved();
        this.light.show();
        this.writeSoon();
      },
      lost: () => {
        this.told.lost();
        banner("The browser has lost the graphics of this page. The picture comes back with them; if it does not, reload the page.", { stays: true });
      },
      failed: (/** @type {unknown} */ error) => this.failed(error),
    };
  }

  /**
   * Read a face that was lost again, and show it as it was.
   * @param {import('../view/types.js').Read} read
   * @param {string | null} asset
   */
  async restore(read, asset) {
    const place = this.face?.place() ?? null;
    if (asset !== null) {
      this.told.restore(asset, place);
      return;
    }
    try {
      await this.show(read, place);
    } catch (error) {
      message(null);
      this.failed(error);
    }
  }

  /** There is no service: exact tiles cannot be had. */
  withoutService() {
    this.exactAllowed = false;
    this.look.allowExact(false);
  }

  /** What the address says; a face is looked for by who has some. @param {string} [hash] */
  readAddress(hash = location.hash) {
    const { state, camera } = address.read(hash);
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
      v: { does: "The next view", run: () => page.views.next() },
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
