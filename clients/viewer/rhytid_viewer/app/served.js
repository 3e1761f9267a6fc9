// What a page of a running service has beside one of a package: assets, exact tiles, uploads.

import { Building } from "./building.js";
import { Connection } from "./connection.js";
import { byId, make } from "./dom.js";
import { ExactTiles } from "./exact.js";
import { addIntake } from "./intake.js";
import { askKey, banner, message, reason } from "./messages.js";
import { Service } from "./service.js";

/**
 * @typedef {import('./address.js').Place} Place
 * @typedef {import('./service.js').Asset} Asset
 */

export class Served {
  /**
   * @param {import('./page.js').Page} page
   * @param {URL} root
   * @param {Record<string, string>} places that the service tells
   */
  constructor(page, root, places) {
    this.page = page;
    this.service = new Service(root, askKey);
    this.building = new Building(this.service);
    this.connection = new Connection(this.service, (online) => this.reached(online));
    this.select = byId("asset", HTMLSelectElement);
    /** @type {Asset[]} */
    this.assets = [];
    /** @type {ExactTiles | null} */
    this.exact = null;
    this.showPlaces(places);
    addIntake(page, (upload) => this.build(upload));
    this.select.addEventListener("change", () => this.choose(this.select.value, null));
    page.store.listen((state, changed) => changed.has("method") && this.turn(state.method));
    page.told = {
      shown: (face) => this.shown(face),
      posed: () => this.exact?.posed(),
      moved: () => this.exact?.moved(),
      exactAt: (udim, texel) => this.exact?.heightAt(udim, texel) ?? null,
    };
    window.addEventListener("pagehide", () => this.exact?.dispose());
    window.addEventListener("hashchange", () => this.followAddress());
  }

  /**
   * Show the asset of the address, else the first that is ready.
   * @param {string | null} asset
   * @param {Place | null} place
   */
  async begin(asset, place) {
    message("Asking the service");
    await this.refresh();
    const ready = this.assets.filter((one) => one.state === "ready");
    const found = asset === null ? ready[0] : ready.find((one) => one.id === asset);
    if (asset !== null && !found) {
      message("The asset of the address is not there.", `The service has no asset ${asset} that is ready. Choose one above, or drop a mesh.`);
    } else if (!found) {
      message("No asset yet.", "Drop a mesh with its shapes here: OBJ, PLY, glTF, GLB or npz. The service grows its skin.");
    } else {
      await this.choose(found.id, place);
    }
  }

  /** Ask which assets there are. */
  async refresh() {
    this.assets = await this.service.assets();
    const options = this.assets.map((one) => {
      const text = one.state === "ready" ? titleOf(one) : `${titleOf(one)} (${one.state})`;
      const option = make("option", { value: one.id }, [text]);
      option.disabled = one.state !== "ready";
      return option;
    });
    this.select.replaceChildren(...options);
    byId("asset-field", HTMLLabelElement).hidden = !options.length;
    this.select.value = this.page.store.state.asset ?? "";
  }

  /** @param {string} id @param {Place | null} place */
  async choose(id, place) {
    const before = this.page.store.state.asset;
    this.page.store.set({ asset: id });
    this.select.value = id;
    if (before !== null && before !== id) this.page.store.set({ weights: {} });
    try {
      const making = (/** @type {import('./service.js').Job} */ job) =>
        message("The service makes the package of this asset", job.stage, job.progress);
      await this.page.show(this.service.reader(id, making), place);
    } catch (error) {
      this.page.store.set({ asset: before });
      this.select.value = before ?? "";
      message(null);
      this.page.failed(error);
    }
  }

  /** @param {import('./face.js').Face} face */
  shown(face) {
    this.exact?.dispose();
    const { asset, method } = this.page.store.state;
    this.exact = new ExactTiles(
      this.service,
      asset ?? "",
      face.view,
      (progress) => {
        this.page.note = noted(progress);
        face.redraw();
      },
      () => this.connection.check(),
    );
    this.turn(method);
  }

  /** @param {string} method */
  turn(method) {
    this.exact?.turn(method === "exact");
    if (method !== "exact") this.page.note = "";
  }

  followAddress() {
    const asset = new URLSearchParams(location.hash.slice(1)).get("asset");
    if (asset !== null && asset !== this.page.store.state.asset) this.choose(asset, null);
  }

  /** @param {boolean} online */
  async reached(online) {
    if (!online) {
      banner("The service does not answer. What is loaded stays; the page asks again by itself.", { stays: true });
      return;
    }
    try {
      await this.refresh();
      const { asset } = this.page.store.state;
      if (asset === null) await this.begin(null, null);
      else if (this.assets.every((one) => one.id !== asset)) {
        banner("The service is back, without this asset. What is loaded stays; send the mesh again for exact tiles.", { stays: true });
        return;
      }
      banner("The service is back.");
      this.exact?.again();
    } catch (error) {
      banner(reason(error), { stays: true });
    }
  }

  /** Send a mesh and show what becomes of it. @param {import('./files_dialog.js').Upload} upload */
  async build(upload) {
    const id = await this.building.run(upload);
    await this.refresh();
    await this.choose(id, null);
  }

  /** @param {Record<string, string>} places */
  showPlaces(places) {
    byId("service-part", HTMLDetailsElement).hidden = false;
    const docs = make("a", { href: places.docs, target: "_blank" }, ["HTTP"]);
    byId("places", HTMLParagraphElement).replaceChildren(`rhytid ${places.version} · `, docs);
  }
}

/** @param {Asset} asset */
function titleOf({ id, settings, triangles }) {
  const size = settings.resolution ? `${settings.resolution}², ` : "";
  return `${id.slice(0, 8)} · ${size}${triangles.toLocaleString("en")} triangles`;
}

/** @param {import('./exact.js').Progress} progress */
function noted({ wanted, shown, problem }) {
  if (problem) return `exact: ${problem}`;
  if (wanted === 0) return "exact: …";
  return shown < wanted ? `exact: ${shown} of ${wanted} tiles` : `exact: all ${wanted} tiles`;
}
