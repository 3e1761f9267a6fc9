// Method, strength, colours, axes and the split, and what they show on the picture.

import { byId, make } from "./dom.js";

/** @typedef {import('./state.js').State} State */

const NAMES = { neutral: "Neutral", fast: "Fast", exact: "Exact" };

export class LookPanel {
  /**
   * @param {import('./state.js').Store} store
   * @param {readonly import('../view/types.js').LegendEntry[]} legend
   */
  constructor(store, legend) {
    this.store = store;
    this.methods = /** @type {HTMLInputElement[]} */ ([...document.querySelectorAll("input[name=method]")]);
    this.strength = byId("strength", HTMLInputElement);
    this.colours = byId("colours", HTMLInputElement);
    this.axes = byId("axes", HTMLInputElement);
    this.split = byId("split", HTMLInputElement);
    for (const radio of this.methods) {
      radio.addEventListener("change", () => store.set({ method: /** @type {State["method"]} */ (radio.value) }));
    }
    this.strength.addEventListener("input", () => store.set({ strength: this.strength.valueAsNumber }));
    this.colours.addEventListener("change", () => store.set({ colours: this.colours.checked ? "stretch" : "skin" }));
    this.axes.addEventListener("change", () => store.set({ axes: this.axes.checked }));
    this.split.addEventListener("change", () => store.set({ split: this.split.checked ? 0.5 : null }));
    drawLegend(legend);
    store.listen((state) => this.show(state));
    this.show(store.state);
  }

  /** Without a service there are no exact tiles. @param {boolean} possible */
  allowExact(possible) {
    for (const radio of this.methods) {
      if (radio.value !== "exact") continue;
      radio.disabled = !possible;
      if (radio.parentElement && !possible) radio.parentElement.title = "Exact tiles come from a running service";
    }
    if (!possible && this.store.state.method === "exact") this.store.set({ method: "fast" });
  }

  /** @param {State} state */
  show(state) {
    for (const radio of this.methods) radio.checked = radio.value === state.method;
    this.strength.valueAsNumber = state.strength;
    byId("strength-value", HTMLOutputElement).value = state.strength.toFixed(2);
    this.colours.checked = state.colours === "stretch";
    this.axes.checked = state.axes;
    this.split.checked = state.split !== null;
    byId("legend", HTMLDivElement).hidden = state.colours !== "stretch";
    byId("before-label", HTMLDivElement).hidden = state.split === null;
    const after = byId("after-label", HTMLDivElement);
    after.hidden = state.split === null;
    after.textContent = NAMES[state.method];
  }
}

/** @param {readonly import('../view/types.js').LegendEntry[]} entries */
function drawLegend(entries) {
  const bar = byId("legend-bar", HTMLDivElement);
  bar.style.background = `linear-gradient(to right, ${entries.map((entry) => entry.colour).join(", ")})`;
  const every = Math.max(1, Math.round((entries.length - 1) / 4));
  const shown = entries.filter((_, index) => index % every === 0);
  byId("legend-ticks", HTMLDivElement).replaceChildren(
    ...shown.map((entry) => make("span", {}, [entry.ratio.toFixed(2)])),
  );
}
