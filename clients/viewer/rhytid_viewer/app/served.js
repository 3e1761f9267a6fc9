// What a page of a running service has beside one of a package: assets, exact tiles, uploads.

import { Building } from "./building.js";
import { Connection } from "./connection.js";
import { byId, make } from "./dom.js";
import { ExactTiles } from "./exact.js";
import { addIntake } from "./intake.js";
import { askKey, banner, message, reason } from "./messages.js";
import { Refused } from "./retry.js";
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
    /** The asset that is shown, or is to be as soon as it is loaded. @type {string | null} */
    this.chosen = null;
    /** Ends the loading of an asset when another one is chosen. */
    this.loading = new AbortController();
    this.showPlaces(places);
    addIntake(page, (upload, signal) => this.build(upload, signal));
    this.select.addEventListener("change", () => this.choose(this.select.value, null));
    page.store.listen((state, changed) => changed.has("method") && this.turn(state.method));
    page.told = {
      shown: (face, asset) => this.shown(face, asset),
      posed: () => this.exact?.posed(),
      moved: () => this.exact?.moved(),
      lost: () => {
        this.exact?.dispose();
        this.exact = null;
      },
      restore: (asset, place) => void this.choose(asset, place),
      exactAt: (udim, texel) => this.exact?.heightAt(udim, texel) ?? null,
    };
    window.addEventListener("pagehide", () => this.exact?.dispose());
    window.addEventListener("pageshow", (event) => event.persisted && this.turn(page.store.state.method));
    window.addEventListener("hashchange", ({ newURL }) => void this.followAddress(new URL(newURL).hash));
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
      const title = titleOf(one, this.assets);
      const text = one.state === "ready" ? title : `${title} (${one.state})`;
      const option = make("option", { value: one.id }, [text]);
      option.disabled = one.state !== "ready";
      return option;
    });
    this.select.replaceChildren(...options);
    byId("asset-field", HTMLLabelElement).hidden = !options.length;
    this.select.value = this.chosen ?? "";
  }

  /**
   * Show an asset in place of what is shown or is being loaded.
   * @param {string} id
   * @param {Place | null} place
   * @param {boolean} again whether to begin once more where the asset changes while it is read
   */
  async choose(id, place, again = true) {
    this.loading.abort();
    this.loading = new AbortController();
    const { signal } = this.loading;
    this.chosen = id;
    this.select.value = id;
    try {
      const making = (/** @type {import('./service.js').Job} */ job) =>
        message("The service makes the package of this asset", job.stage, job.progress);
      await this.page.show(this.service.reader(id, making, signal), place, { asset: id, signal });
    } catch (error) {
      if (signal.aborted) return;
      if (again && error instanceof Refused && error.status === 409) {
        await this.choose(id, place, false);
        return;
      }
      this.chosen = this.page.store.state.asset;
      this.select.value = this.chosen ?? "";
      message(null);
      this.page.failed(error);
    }
  }

  /** @param {import('./face.js').Face} face @param {string | null} asset */
  shown(face, asset) {
    this.exact?.dispose();
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
    this.turn(this.page.store.state.method);
  }

  /** @param {string} method */
  turn(method) {
    this.exact?.turn(method === "exact");
    if (method !== "exact") this.page.note = "";
  }

  /** Another address: its asset, where the service lists it. @param {string} hash */
  async followAddress(hash) {
    const asset = new URLSearchParams(hash.slice(1)).get("asset");
    if (asset === null || asset === this.chosen) return;
    const { loading } = this;
    try {
      await this.refresh();
    } catch (error) {
      banner(reason(error), { stays: true });
      return;
    }
    if (loading !== this.loading) return; // something else was chosen meanwhile
    const found = this.assets.some(({ id, state }) => id === asset && state === "ready");
    if (found) await this.choose(asset, null);
    else banner(`The service has no asset ${asset} that is ready.`, { stays: true });
  }

  /** @param {boolean} online */
  async reached(online) {
    if (!online) {
      banner("The service does not answer. What is loaded stays; the page asks again by itself.", { stays: true });
      return;
    }
    try {
      await this.refresh();
      const asset = this.chosen;
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

  /**
   * Send a mesh, and show what becomes of it as soon as it is built.
   * @param {import('./files_dialog.js').Upload} upload
   * @param {AbortSignal} signal ends the sending
   * @throws {Error} where the service does not take it
   */
  async build(upload, signal) {
    const asset = await this.building.send(upload, signal);
    this.grown(asset).catch((error) => banner(`${upload.mesh.name}: ${reason(error)}`, { stays: true }));
  }

  /** @param {Asset} asset */
  async grown(asset) {
    await this.building.built(asset);
    await this.refresh();
    await this.choose(asset.id, null);
  }

  /** @param {Record<string, string>} places */
  showPlaces(places) {
    byId("service-part", HTMLDetailsElement).hidden = false;
    const docs = make("a", { href: places.docs, target: "_blank" }, ["HTTP"]);
    byId("places", HTMLParagraphElement).replaceChildren(`rhytid ${places.version} · `, docs);
  }
}

/**
 * Its name, with the id where it has none or another asset has it, too.
 * @param {Asset} asset
 * @param {Asset[]} all
 */
function titleOf({ id, settings, triangles }, all) {
  const { name } = settings;
  const known = name && all.every((other) => other.id === id || other.settings.name !== name);
  const title = known ? name : [name, id.slice(0, 8)].filter(Boolean).join(" ");
  const size = settings.resolution ? `${settings.resolution}², ` : "";
  return `${title} · ${size}${triangles.toLocaleString("en")} triangles`;
}

/** @param {import('./exact.js').Progress} progress */
function noted({ wanted, shown, problem }) {
  if (problem) return `exact: ${problem}`;
  if (wanted === 0) return "exact: …";
  return shown < wanted ? `exact: ${shown} of ${wanted} tiles` : `exact: all ${wanted} ${wanted === 1 ? "tile" : "tiles"}`;
}
