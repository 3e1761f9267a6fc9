// Sliders of the shapes, in groups, with a filter.

import { byId, make } from "./dom.js";
import { ORDER, groupOf } from "./shape_names.js";
import { weightOf } from "./state.js";

export class ShapesPanel {
  /**
   * @param {import('./state.js').Store} store
   * @param {() => void} onTouched somebody moves a slider
   */
  constructor(store, onTouched) {
    this.store = store;
    this.onTouched = onTouched;
    this.list = byId("shape-list", HTMLDivElement);
    this.filter = byId("shape-filter", HTMLInputElement);
    this.count = byId("shape-count", HTMLSpanElement);
    /** @type {Map<string, {row: HTMLElement, slider: HTMLInputElement, value: HTMLOutputElement}>} */
    this.rows = new Map();
    this.filter.addEventListener("input", () => this.showFiltered());
    byId("shape-reset", HTMLButtonElement).addEventListener("click", () => this.reset());
    store.listen((state, changed) => changed.has("weights") && this.showWeights(state.weights));
  }

  /** @param {readonly string[]} names of the shapes of a face */
  fill(names) {
    this.rows.clear();
    const groups = ORDER.map((group) => /** @type {const} */ ([group, names.filter((name) => groupOf(name) === group)]));
    const used = groups.filter(([, own]) => own.length);
    const made = used.map(([group, own]) => {
      const rows = own.map((name) => this.row(name));
      if (used.length < 2) return make("div", {}, rows);
      return make("details", { open: "", class: "group" }, [make("summary", {}, [group]), ...rows]);
    });
    const none = make("p", { class: "quiet" }, ["This face has no shapes: its skin stays at rest."]);
    this.list.replaceChildren(...(names.length ? made : [none]));
    this.filter.value = "";
    this.showWeights(this.store.state.weights);
  }

  /** @param {string} name */
  row(name) {
    const slider = make("input", { type: "range", min: "0", max: "1", step: "0.01", "aria-label": name });
    const value = make("output");
    const label = make("span", { title: `${name}: double-click for 0` }, [name]);
    const row = make("div", { class: "row shape", "data-shape": name }, [label, slider, value]);
    slider.addEventListener("input", () => {
      this.onTouched();
      this.store.setWeight(name, slider.valueAsNumber);
    });
    row.addEventListener("dblclick", () => {
      this.onTouched();
      this.store.setWeight(name, 0);
    });
    this.rows.set(name, { row, slider, value });
    return row;
  }

  /** @param {Readonly<Record<string, number>>} weights */
  showWeights(weights) {
    let moved = 0;
    for (const [name, { row, slider, value }] of this.rows) {
      const weight = weightOf(weights, name);
      if (weight) moved += 1;
      const text = weight.toFixed(2);
      if (value.value === text && slider.valueAsNumber === weight) continue;
      slider.valueAsNumber = weight;
      value.value = text;
      row.classList.toggle("moved", weight !== 0);
    }
    this.count.textContent = moved ? `${moved} of ${this.rows.size}` : `${this.rows.size}`;
  }

  showFiltered() {
    const words = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const [name, { row }] of this.rows) {
      row.hidden = !words.every((word) => name.toLowerCase().includes(word));
    }
    for (const group of this.list.querySelectorAll("details")) {
      group.hidden = !group.querySelector(".shape:not([hidden])");
      if (words.length) group.open = true;
    }
  }

  reset() {
    this.onTouched();
    this.store.set({ weights: {} });
  }
}
