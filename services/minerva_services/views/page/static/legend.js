/** The legend: what the colours of a picture mean. */

const WORDS = /[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+/g;

/** The words of a symbol's or event type's name: `big tree` for `PBigTree`. */
export const words = (name) => (name.slice(1).match(WORDS) ?? [name]).join(" ").toLowerCase();

/** Whether a line of this colour is invisible on paper: a relative luminance (WCAG 2.2) above 0.7. */
export function isPale(colour) {
  const digits = colour.length === 4 ? [...colour.slice(1)].map((digit) => digit + digit).join("") : colour.slice(1);
  const [red, green, blue] = digits.match(/../g).map((part) => (parseInt(part, 16) / 255) ** 2.2);
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.7;
}

/** The entries for primitives: `{text, form, colour}`, things first, then matrices. */
export function legend(symbols, vocabulary) {
  const entries = [...symbols].sort().flatMap((symbol) => entriesOf(symbol, vocabulary));
  const isGround = ({ form }) => form === "raster";
  const sorted = [...entries.filter((entry) => !isGround(entry)), ...entries.filter(isGround)];
  return [...new Map(sorted.map((entry) => [JSON.stringify(entry), entry])).values()];
}

function entriesOf(symbol, vocabulary) {
  const [form, ...measures] = vocabulary.forms.get(symbol) ?? [];
  const meanings = vocabulary.meanings.get(symbol) ?? [];
  if (form === undefined) return [];
  if (form !== "raster") return [{ text: meanings[0] || words(symbol), form, colour: measures[form === "line" ? 2 : 1] }];
  const colours = measures[5].map(([, colour]) => colour);
  if (meanings.length > 0) {
    return colours.map((colour, n) => ({ text: meanings[n] ?? "", form, colour })).filter(({ text, colour }) => text && colour);
  }
  return colours.filter(Boolean).slice(-1).map((colour) => ({ text: words(symbol), form, colour }));
}
