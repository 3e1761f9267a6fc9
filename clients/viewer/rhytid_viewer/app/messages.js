// What the page tells besides the picture.

import { byId } from "./dom.js";
import { isKey } from "./service.js";

const SECONDS = 8;
let timer = 0;

/**
 * A line on top, which goes by itself unless it is to stay; null takes it away.
 * @param {string | null} text
 * @param {{stays?: boolean}} [options]
 */
export function banner(text, { stays = false } = {}) {
  const line = byId("banner", HTMLParagraphElement);
  clearTimeout(timer);
  line.textContent = text;
  line.hidden = text === null;
  if (text !== null && !stays) timer = window.setTimeout(() => banner(null), 1000 * SECONDS);
}

/**
 * A message in place of the picture; null takes it away.
 * @param {string | null} text
 * @param {string} [detail]
 * @param {number | null} [share] of what is waited for
 */
export function message(text, detail = "", share = null) {
  byId("message", HTMLDivElement).hidden = text === null;
  byId("message-text", HTMLParagraphElement).textContent = text;
  byId("message-detail", HTMLParagraphElement).textContent = detail;
  const bar = byId("message-progress", HTMLProgressElement);
  bar.hidden = share === null;
  if (share !== null) bar.value = share;
}

/** @param {unknown} error */
export function reason(error) {
  return error instanceof Error ? error.message : String(error);
}

/**
 * Ask for a key until one is given.
 * @param {boolean} wrong whether the one before is not valid
 * @returns {Promise<string>}
 */
export function askKey(wrong) {
  const dialog = byId("key-dialog", HTMLDialogElement);
  const field = byId("key", HTMLInputElement);
  const line = byId("key-wrong", HTMLParagraphElement);
  line.hidden = !wrong;
  line.textContent = wrong ? "The service does not know this key, or it is no longer valid." : "";
  field.value = "";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.oncancel = (event) => event.preventDefault();
    dialog.onclose = () => {
      const key = field.value.trim();
      if (isKey(key)) resolve(key);
      else {
        line.hidden = false;
        line.textContent = "This is no key: keys have ASCII letters, digits and signs alone, without spaces.";
        dialog.showModal();
      }
    };
  });
}
