/** Elements of panels, and texts that fit them. */

/** A new element with a class, and texts or elements in it. */
export function make(tag, name = "", ...content) {
  const element = document.createElement(tag);
  if (name !== "") element.className = name;
  element.append(...content);
  return element;
}

const LONG_NUMBER = /-?\d+\.\d{6,}(?:e[+-]?\d+)?/g;

/** A text that fits its place; numbers have six digits. */
export function short(text, most = 60) {
  const rounded = text.replace(LONG_NUMBER, (number) => String(Number(Number(number).toPrecision(6))));
  return rounded.length > most ? `${rounded.slice(0, most - 1)}…` : rounded;
}
