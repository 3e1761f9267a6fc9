// Mouse, pen and fingers on the canvas.

/**
 * @typedef {object} Gestures
 * @property {(dx: number, dy: number) => void} orbit CSS pixels
 * @property {(dx: number, dy: number) => void} pan CSS pixels
 * @property {(factor: number, x: number, y: number) => void} zoom
 * @property {(dx: number, dy: number) => void} light CSS pixels
 * @property {(x: number, y: number) => void} probe CSS pixels in the canvas
 * @property {(x: number, y: number) => void} centre
 * @property {() => boolean} lightKey whether the key of the light is held
 */

/** @param {HTMLElement} canvas @param {Gestures} gestures */
export function addPointer(canvas, gestures) {
  /** Where each finger or button is, and what it does. @type {Map<number, {x: number, y: number, does: 'orbit' | 'pan' | 'light'}>} */
  const held = new Map();

  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, { x: event.clientX, y: event.clientY, does: meant(event, gestures.lightKey()) });
    probe(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) {
      probe(event);
      return;
    }
    const after = { ...before, x: event.clientX, y: event.clientY };
    if (held.size >= 2) pinch(event.pointerId, after);
    else gestures[before.does](after.x - before.x, after.y - before.y);
    held.set(event.pointerId, after);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => held.delete(/** @type {PointerEvent} */ (event).pointerId));
  }
  canvas.addEventListener("dblclick", (event) => gestures.centre(...within(event)));
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
      gestures.zoom(Math.exp(0.0015 * lines * event.deltaY), ...within(event));
    },
    { passive: false },
  );

  /** @param {MouseEvent} event @returns {[number, number]} */
  function within(event) {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /** @param {PointerEvent} event */
  function probe(event) {
    gestures.probe(...within(event));
  }

  /** Two fingers: together they move, apart they come closer. @param {number} id @param {{x: number, y: number}} after */
  function pinch(id, after) {
    const before = held.get(id);
    const other = [...held].find(([key]) => key !== id)?.[1];
    if (!before || !other) return;
    gestures.pan((after.x - before.x) / 2, (after.y - before.y) / 2);
    const [was, is] = [before, after].map((at) => Math.hypot(at.x - other.x, at.y - other.y));
    const box = canvas.getBoundingClientRect();
    if (is > 1) gestures.zoom(was / is, (after.x + other.x) / 2 - box.left, (after.y + other.y) / 2 - box.top);
  }
}

/** @param {PointerEvent} event @param {boolean} lightKey @returns {'orbit' | 'pan' | 'light'} */
function meant(event, lightKey) {
  if (event.button === 2 || lightKey) return "light";
  return event.button === 1 || event.shiftKey ? "pan" : "orbit";
}
