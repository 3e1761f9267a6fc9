// Which shapes of a face are meant by a name, as the service has it: `eyeBlink_L`, `EyeBlinkLeft` and
// `face|eyeBlink.l` are one, and a name without a side means both where a face has them apart.

const SIDE = /(?:[ ._-]?(?:(left)|(right))|[ ._-](?:(l)|(r)))$/i;
const LETTER = /(?<=[a-z])(?:(L)|(R))$/;

/**
 * The stem in lower case and the side.
 * @param {string} name
 * @returns {{stem: string, side: 'left' | 'right' | ''}}
 */
export function nameParts(name) {
  /** @type {'left' | 'right' | ''} */
  let side = "";
  let rest = name;
  const found = SIDE.exec(name) ?? LETTER.exec(name);
  if (found && found.index) {
    side = found[1] || found[3] ? "left" : "right";
    rest = name.slice(0, found.index);
  }
  const last = rest.split(/[.:|/]/).at(-1) ?? "";
  return { stem: last.toLowerCase().replace(/[^a-z0-9]/g, ""), side };
}

/**
 * For each wanted name the indices of the shapes that it means.
 * @param {readonly string[]} wanted
 * @param {readonly string[]} known
 * @returns {number[][]}
 */
export function meantShapes(wanted, known) {
  const parts = known.map(nameParts);
  /** @param {string} stem @param {string} side */
  const first = (stem, side) => {
    const index = parts.findIndex((part) => part.stem === stem && part.side === side);
    return index < 0 ? [] : [index];
  };
  return wanted.map((name) => {
    const exact = known.indexOf(name);
    if (exact >= 0) return [exact];
    const { stem, side } = nameParts(name);
    const found = first(stem, side);
    return found.length || side ? found : [...first(stem, "left"), ...first(stem, "right")];
  });
}

const GROUPS = ["brow", "eye", "nose", "cheek", "mouth", "jaw", "tongue"];
const SAME = { lip: "mouth", pucker: "mouth", funnel: "mouth", squint: "eye", blink: "eye", smile: "mouth", frown: "mouth", lid: "eye", sneer: "nose", chin: "jaw" };

/**
 * The part of the face that a shape moves, by its name; "other" where the name says nothing.
 * @param {string} name
 */
export function groupOf(name) {
  const plain = name.toLowerCase().replace(/[^a-z]/g, "");
  const found = GROUPS.find((group) => plain.startsWith(group)) ?? GROUPS.find((group) => plain.includes(group));
  return found ?? Object.entries(SAME).find(([word]) => plain.includes(word))?.[1] ?? "other";
}

/** In the order in which they are shown. */
export const ORDER = [...GROUPS, "other"];
