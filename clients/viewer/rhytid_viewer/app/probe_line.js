// What lies under the pointer, in figures.

import { byId } from "./dom.js";

const PARTS = ["displacement", "stretch", "triangle", "texel"];

/**
 * @param {import('../view/types.js').Probe | null} probe
 * @param {import('../view/types.js').Manifest} manifest
 * @param {number} level of the texels whose mean the displacement is
 */
export function showProbe(probe, manifest, level) {
  const texts = probe ? described(probe, manifest) : PARTS.map(() => "–");
  if (probe && level) texts[0] += ` of ${1 << level}² texels`;
  PARTS.forEach((part, index) => (byId(`probe-${part}`, HTMLElement).textContent = texts[index]));
}

/**
 * @param {import('../view/types.js').Probe} probe
 * @param {import('../view/types.js').Manifest} manifest
 */
function described(probe, manifest) {
  const { displacement, ratios, triangle, udim, texel } = probe;
  return [
    depth(displacement, manifest.unit_in_metres, manifest.unit),
    `${ratios[0].toFixed(3)} × ${ratios[1].toFixed(3)}`,
    String(triangle),
    `${udim}: ${texel[0]}, ${texel[1]}`,
  ];
}

/** @param {number} value @param {number | null} metres @param {string} unit */
function depth(value, metres, unit) {
  if (metres === null) return `${value.toPrecision(4)} ${unit}`;
  const micrometres = value * metres * 1e6;
  const text = Math.abs(micrometres) < 0.05 ? "0.0" : micrometres.toFixed(1);
  return `${text.replace("-", "−")} µm`;
}
