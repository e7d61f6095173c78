/** The legend: what the colours of a picture mean. */

const WORDS = /[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+/g;

/** The words of a symbol's or event type's name: `big tree` for `PBigTree`. */
export const words = (name) => (name.slice(1).match(WORDS) ?? [name]).join(" ").toLowerCase();

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
