// The line between neutral and posed skin, dragged or moved by keys.

import { byId } from "./dom.js";

const STEP = 0.02;

/** @param {import('./state.js').Store} store @param {HTMLElement} stage */
export function addDivider(store, stage) {
  const line = byId("divider", HTMLDivElement);
  const move = (/** @type {number} */ share) => store.set({ split: Math.min(1, Math.max(0, share)) });
  line.addEventListener("pointerdown", (event) => {
    line.setPointerCapture(event.pointerId);
    event.preventDefault();
    line.focus();
  });
  line.addEventListener("pointermove", (event) => {
    if (!line.hasPointerCapture(event.pointerId)) return;
    const box = stage.getBoundingClientRect();
    move((event.clientX - box.left) / box.width);
  });
  line.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: -STEP, ArrowRight: STEP, Home: -1, End: 1 };
    const by = turns[/** @type {keyof typeof turns} */ (event.key)];
    if (by === undefined) return;
    move((store.state.split ?? 0.5) + by);
    event.preventDefault();
    event.stopPropagation();
  });
  store.listen((state) => {
    line.hidden = state.split === null;
    const percent = `${100 * (state.split ?? 0)}`;
    line.style.left = `${percent}%`;
    line.setAttribute("aria-valuenow", String(Math.round(Number(percent))));
  });
}
