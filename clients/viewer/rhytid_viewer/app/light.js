// The light, moved as the picture shows it: by a small ball, or by dragging over the face.

import { byId } from "./dom.js";

/** @typedef {import('../view/types.js').Vector} Vector */

const STEP = 0.12;

export class Light {
  /**
   * @param {import('./state.js').Store} store
   * @param {() => {yaw: number, pitch: number} | null} camera
   */
  constructor(store, camera) {
    this.store = store;
    this.camera = camera;
    this.ball = byId("light", HTMLDivElement);
    this.spot = byId("light-spot", HTMLDivElement);
    this.ball.addEventListener("pointerdown", (event) => {
      this.ball.setPointerCapture(event.pointerId);
      this.place(event);
    });
    this.ball.addEventListener("pointermove", (event) => {
      if (this.ball.hasPointerCapture(event.pointerId)) this.place(event);
    });
    this.ball.addEventListener("keydown", (event) => {
      const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      const by = moves[/** @type {keyof typeof moves} */ (event.key)];
      if (!by) return;
      this.turn(by[0] * STEP, by[1] * STEP);
      event.preventDefault();
      event.stopPropagation();
    });
    store.listen((_state, changed) => changed.has("light") && this.show());
    this.show();
  }

  /** Where it is in the picture: x to the right, y up, z to who looks. @returns {Vector} */
  seen() {
    const [x, y, z] = unit(this.store.state.light);
    return /** @type {Vector} */ (this.basis().map((axis) => axis[0] * x + axis[1] * y + axis[2] * z));
  }

  /** @param {Vector} seen */
  set(seen) {
    const [x, y, z] = unit(seen);
    const [right, up, back] = this.basis();
    const at = (/** @type {number} */ i) => x * right[i] + y * up[i] + z * back[i];
    this.store.set({ light: [at(0), at(1), at(2)] });
  }

  /**
   * Turn it around the face.
   * @param {number} across radians to the right
   * @param {number} down radians
   */
  turn(across, down) {
    const [x, y, z] = this.seen();
    const longitude = Math.atan2(x, z) + across;
    const latitude = Math.min(1.5, Math.max(-1.5, Math.asin(y) - down));
    const flat = Math.cos(latitude);
    this.set([flat * Math.sin(longitude), Math.sin(latitude), flat * Math.cos(longitude)]);
  }

  /** @param {PointerEvent} event over the ball, whose outline is light from the side */
  place(event) {
    const box = this.ball.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1;
    const y = 1 - (2 * (event.clientY - box.top)) / box.height;
    const far = Math.hypot(x, y);
    const shrink = far > 1 ? 1 / far : 1;
    this.set([x * shrink, y * shrink, Math.sqrt(Math.max(0, 1 - far * far))]);
  }

  /** Show it on the ball. */
  show() {
    const [x, y, z] = this.seen();
    this.spot.style.left = `${50 + 50 * x}%`;
    this.spot.style.top = `${50 - 50 * y}%`;
    this.spot.classList.toggle("behind", z < 0);
    this.ball.style.setProperty("--x", `${50 + 50 * x}%`);
    this.ball.style.setProperty("--y", `${50 - 50 * y}%`);
  }

  /** To the right, up and towards who looks, in the axes of the mesh. @returns {[Vector, Vector, Vector]} */
  basis() {
    const { yaw, pitch } = this.camera() ?? { yaw: 0, pitch: 0 };
    const [s, c, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
    return [
      [c, 0, -s],
      [-s * sp, cp, -c * sp],
      [s * cp, sp, c * cp],
    ];
  }
}

/** @param {Readonly<Vector>} vector @returns {Vector} */
function unit([x, y, z]) {
  const length = Math.hypot(x, y, z) || 1;
  return [x / length, y / length, z / length];
}
