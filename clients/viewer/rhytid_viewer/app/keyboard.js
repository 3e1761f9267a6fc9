// Keys, and the list of them.

import { byId, make } from "./dom.js";

/** Keys that move: dx, dy in steps. @type {Record<string, [number, number]>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP = 24;
const CLOSER = 0.88;

/** What the list shows beside the keys of `actions`. */
const OTHERS = [
  ["Arrow keys, drag", "Turn around the face"],
  ["Shift + arrow keys, Shift + drag, two fingers", "Move"],
  ["+ and −, wheel, pinch", "Closer, further"],
  ["L + arrow keys, L + drag, right button", "Move the light"],
  ["Double-click", "Look at this place"],
];

/**
 * @typedef {object} Moves
 * @property {(dx: number, dy: number) => void} orbit
 * @property {(dx: number, dy: number) => void} pan
 * @property {(factor: number) => void} zoom
 * @property {(dx: number, dy: number) => void} light
 *
 * @typedef {Record<string, {does: string, run: () => void}>} Actions by key, in lower case
 */

/**
 * @param {Moves} moves
 * @param {Actions} actions
 * @returns {() => boolean} whether L is held
 */
export function addKeyboard(moves, actions) {
  let lightKey = false;
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isText(event.target)) return;
    const key = event.key.toLowerCase();
    if (key === "l") lightKey = true;
    const arrow = ARROWS[event.key];
    if (arrow && !usesArrows(event.target)) {
      const how = lightKey ? moves.light : event.shiftKey ? moves.pan : moves.orbit;
      how(arrow[0] * STEP, arrow[1] * STEP);
    } else if ((key === "+" || key === "=" || key === "-") && !usesArrows(event.target)) {
      moves.zoom(key === "-" ? 1 / CLOSER : CLOSER);
    } else if (actions[key] && !(key === " " && usesSpace(event.target)) && !event.repeat) {
      actions[key].run();
    } else {
      return;
    }
    event.preventDefault();
  });
  document.addEventListener("keyup", (event) => {
    if (event.key.toLowerCase() === "l") lightKey = false;
  });
  window.addEventListener("blur", () => (lightKey = false));
  list(actions);
  return () => lightKey;
}

/** @param {Actions} actions */
function list(actions) {
  const own = Object.entries(actions).map(([key, { does }]) => [key === " " ? "Space" : key.toUpperCase(), does]);
  const rows = [...OTHERS, ...own].map(([keys, does]) =>
    make("div", {}, [make("dt", {}, [keys]), make("dd", {}, [does])]),
  );
  byId("help-list", HTMLDListElement).replaceChildren(...rows);
}

/** @param {EventTarget | null} target */
function isText(target) {
  if (target instanceof HTMLInputElement) return !["range", "checkbox", "radio"].includes(target.type);
  return target instanceof HTMLSelectElement || document.querySelector("dialog[open]") !== null;
}

/** @param {EventTarget | null} target */
function usesArrows(target) {
  return target instanceof HTMLInputElement && target.type !== "checkbox";
}

/** @param {EventTarget | null} target */
function usesSpace(target) {
  return target instanceof HTMLButtonElement || target instanceof HTMLInputElement || target instanceof HTMLElement && target.tagName === "SUMMARY";
}
