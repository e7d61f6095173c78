/** The legend: what the colours of a picture mean. */

import { colourOf, scaleOf } from "./geometry.js";

const WORDS = /[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+/g;

/** The words of a symbol's or event type's name: `big tree` for `PBigTree`. */
export const words = (name) => (name.slice(1).match(WORDS) ?? [name]).join(" ").toLowerCase();

/** Whether a line of this colour is invisible on paper: a relative luminance (WCAG 2.2) above 0.7. */
export function isPale(colour) {
  const digits = colour.length === 4 ? [...colour.slice(1)].map((digit) => digit + digit).join("") : colour.slice(1);
  const [red, green, blue] = digits.match(/../g).map((part) => (parseInt(part, 16) / 255) ** 2.2);
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.7;
}

/** Add what an item draws to `drawn`, the sets of colours by symbol; returns whether it was not drawn before. */
export function include(drawn, { symbol, form, matrix, colour, colours }) {
  const isNew = !drawn.has(symbol);
  if (isNew) drawn.set(symbol, new Set());
  const known = drawn.get(symbol);
  const before = known.size;
  if (form === "raster" && before < colours.length) {
    for (const value of new Set(matrix.values)) known.add(colourOf(value, colours));
  } else if (form === "disc") known.add(colour);
  return isNew || known.size > before;
}

/**
 * The entries for what is drawn: `{text, form, colours}`, things first, then matrices.
 *
 * Each text of a form is listed once, with all of its colours; several look like those of a matrix.
 */
export function legend(drawn, vocabulary, scales) {
  const entries = [...drawn.keys()].sort().flatMap((symbol) => entriesOf(symbol, vocabulary, drawn.get(symbol), scales));
  const isGround = ({ form }) => form === "raster";
  const sorted = [...entries.filter((entry) => !isGround(entry)), ...entries.filter(isGround)];
  const merged = new Map();
  for (const { text, form, colour } of sorted) {
    const key = `${form} ${text}`;
    if (!merged.has(key)) merged.set(key, { text, form, colours: new Set() });
    merged.get(key).colours.add(colour);
  }
  return [...merged.values()].map(({ text, form, colours }) => ({ text, form: colours.size > 1 ? "raster" : form, colours: [...colours] }));
}

function entriesOf(symbol, vocabulary, shown, scales) {
  const [form, ...measures] = vocabulary.forms.get(symbol) ?? [];
  const meanings = vocabulary.meanings.get(symbol) ?? [];
  if (form === undefined) return [];
  const scale = form === "disc" ? scaleOf(measures[1], scales) : null;
  if (scale !== null) return entriesOfScale(meanings[0] || words(symbol), scale, shown);
  if (form !== "raster") return [{ text: meanings[0] || words(symbol), form, colour: measures[form === "line" ? 2 : 1] }];
  const colours = measures[5].map(([, colour]) => colour);
  if (meanings.length > 0) {
    const entries = colours.map((colour, n) => ({ text: meanings[n] ?? "", form, colour }));
    return entries.filter(({ text, colour }) => text && colour && shown.has(colour));
  }
  const shades = measures[5].filter(([, colour]) => colour);
  const ends = shades.length > 3 ? `: ${shades[0][0]} to ${shades.at(-1)[0]}` : "";
  return shades.map(([, colour]) => ({ text: words(symbol) + ends, form, colour }));
}

function entriesOfScale(text, { parameter, low, high, colours, isGrouped }, shown) {
  if (!isGrouped) return colours.map((colour) => ({ text: `${text}: ${parameter} ${low} to ${high}`, form: "raster", colour }));
  const names = text.split(",").map((part) => part.trim());
  const nameOf = (n) => (names.length === colours.length ? names[n] : `${text}: ${parameter} ${low + n}`);
  return colours.map((colour, n) => ({ text: nameOf(n), form: "disc", colour })).filter(({ colour }) => shown.has(colour));
}
