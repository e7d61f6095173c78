/** Conditions of events, in the language of docs/norms.md. */

import { Invalid } from "./msgpack.js";

const TOKEN = /\s*("(?:[^"\\]|\\.)*"|<=|>=|==|!=|[<>(),]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[A-Za-z_]\w*|$)/y;
const COMPARISONS = {
  "<": (a, b) => less(a, b),
  "<=": (a, b) => !less(b, a),
  ">": (a, b) => less(b, a),
  ">=": (a, b) => !less(a, b),
  // A BigInt and a number are compared by value, which `===` does not do.
  "==": (a, b) => a == b,
  "!=": (a, b) => a != b,
};
const MAX_DEPTH = 32;
const cache = new Map();

/** Thrown inside a condition about an attribute that an agent lacks or has with another type. */
class Unanswerable extends Error {}

/** The function that checks whether a state, an object by attribute, meets the condition. */
export function condition(text) {
  let check = cache.get(text);
  if (check === undefined) {
    check = text === "" ? () => true : new Parser(text).whole();
    if (cache.size > 1000) cache.clear();
    cache.set(text, check);
  }
  return (state) => {
    try {
      return check(state);
    } catch (error) {
      if (error instanceof Unanswerable) return false;
      throw error;
    }
  };
}

function tokens(text) {
  const result = [];
  TOKEN.lastIndex = 0;
  for (;;) {
    const match = TOKEN.exec(text);
    if (match === null) throw new Invalid(`the condition ${text} cannot be read`);
    if (match[1] === "") return result;
    result.push(match[1]);
  }
}

class Parser {
  constructor(text) {
    this.text = text;
    this.rest = tokens(text);
    this.depth = 0;
  }

  fail() {
    throw new Invalid(`the condition ${this.text} cannot be read`);
  }

  accept(token) {
    if (this.rest[0] !== token) return false;
    this.rest.shift();
    return true;
  }

  whole() {
    const check = this.either();
    return this.rest.length === 0 ? check : this.fail();
  }

  either() {
    const checks = [this.both()];
    while (this.accept("or")) checks.push(this.both());
    // Without short circuits, because a comparison without an answer decides the whole condition.
    return (state) => checks.map((check) => check(state)).some(Boolean);
  }

  both() {
    const checks = [this.term()];
    while (this.accept("and")) checks.push(this.term());
    return (state) => checks.map((check) => check(state)).every(Boolean);
  }

  term() {
    if (++this.depth > MAX_DEPTH) this.fail();
    const check = this.#term();
    this.depth -= 1;
    return check;
  }

  #term() {
    if (this.accept("not")) {
      const check = this.term();
      return (state) => !check(state);
    }
    if (this.accept("(")) {
      const check = this.either();
      return this.accept(")") ? check : this.fail();
    }
    const left = this.operand();
    const compare = COMPARISONS[this.rest.shift()] ?? this.fail();
    const right = this.operand();
    return (state) => {
      const [a, b] = [left(state), right(state)];
      if (family(a) !== family(b)) throw new Unanswerable();
      return compare(a, b);
    };
  }

  /** The distance between two points, after its opening parenthesis. */
  distance() {
    const values = [this.coordinate()];
    while (values.length < 4) values.push(this.accept(",") ? this.coordinate() : this.fail());
    if (!this.accept(")")) this.fail();
    return (state) => {
      const numbers = values.map((value) => value(state));
      if (numbers.some((value) => family(value) !== "number")) throw new Unanswerable();
      const [x, y, toX, toY] = numbers.map(Number);
      // Not Math.hypot, whose rounding differs between engines.
      return Math.sqrt((x - toX) * (x - toX) + (y - toY) * (y - toY));
    };
  }

  coordinate() {
    if (/^(".*|true|false)$/.test(this.rest[0])) this.fail();
    if (this.rest[0] === "distance" && this.rest[1] === "(") this.fail();
    return this.operand();
  }

  operand() {
    const token = this.rest.shift();
    if (token === undefined || ["and", "or", "not", "(", ")"].includes(token)) this.fail();
    if (Object.hasOwn(COMPARISONS, token)) this.fail();
    if (token === ",") this.fail();
    if (token === "distance" && this.accept("(")) return this.distance();
    const value = literal(token);
    if (value !== undefined) return () => value;
    return (state) => {
      if (!Object.hasOwn(state, token)) throw new Unanswerable();
      return state[token];
    };
  }
}

function literal(token) {
  if (token === "true" || token === "false") return token === "true";
  if (/^[-+]?\d+$/.test(token)) return BigInt(token.replace("+", ""));
  if (/^[-+.\d]/.test(token)) return Number(token);
  if (!token.startsWith('"')) return undefined;
  try {
    return JSON.parse(token);
  } catch {
    throw new Invalid(`the text ${token} cannot be read`);
  }
}

/** Texts are compared by code points, which `<` does not do above U+FFFF. */
function less(a, b) {
  if (typeof a !== "string") return a < b;
  const [left, right] = [a, b].map((text) => Array.from(text, (character) => character.codePointAt(0)));
  const n = left.findIndex((point, place) => point !== right[place]);
  return n < 0 ? left.length < right.length : n < right.length && left[n] < right[n];
}

const family = (value) => (typeof value === "bigint" ? "number" : typeof value);
