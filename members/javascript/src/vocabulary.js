/** The vocabulary of a world, and values of its types. */

import { Extension, Invalid } from "./msgpack.js";

/**
 * The vocabulary of a world: the fields of its symbols and event types, and how symbols are drawn.
 *
 * `forms` maps a primitive or transformation to its form as in section 4 of PROTOCOL.md, a list that
 * begins with the form's name, or to null; `meanings` maps primitives to the texts of a legend;
 * `marks` are the primitives whose labels mark others.
 */
export class Vocabulary {
  constructor(plain) {
    const rows = (part) => {
      if (!(plain instanceof Map) || !Array.isArray(plain.get(part))) throw new Invalid("a vocabulary");
      return plain.get(part).map(([name, fields]) => [name, fields.map(([field, type]) => [field, type])]);
    };
    this.symbols = new Map(["primitives", "transformations", "kinds"].flatMap(rows));
    this.events = new Map(rows("events"));
    const drawn = ["primitives", "transformations"].flatMap((part) => plain.get(part));
    this.forms = new Map(drawn.map(([name, , form]) => [name, numbers(form ?? null)]));
    this.meanings = plain.get("meanings") ?? new Map();
    this.marks = new Set(plain.get("marks"));
  }

  /** The fields of a symbol: pairs of name and type. */
  fields(symbol) {
    return this.symbols.get(symbol) ?? unknown(symbol);
  }

  eventFields(type) {
    return this.events.get(type) ?? unknown(type);
  }
}

const FLAT = ["bool", "int", "real", "text"];

/** Whether values of all these fields can be in columns. */
export const areFlat = (fields) => fields.every(([, type]) => FLAT.includes(type.split(" ")[0]));

/** Measures of a form are reals, whatever number a message has. */
function numbers(form) {
  if (Array.isArray(form)) return form.map(numbers);
  return typeof form === "bigint" ? Number(form) : form;
}

function unknown(name) {
  throw new Invalid(`the world's vocabulary has no ${String(name)}`);
}

/** A value from a message as a value of the type. */
export function read(value, type) {
  if (type.startsWith("list of ")) {
    if (!Array.isArray(value)) throw new Invalid(`not a ${type}`);
    return value.map((item) => read(item, type.slice("list of ".length)));
  }
  const [base] = type.split(" ");
  if (base === "real" && typeof value === "bigint") return Number(value);
  if (base === "real" && typeof value === "number" && Number.isFinite(value)) return value;
  if (base === "int" && typeof value === "bigint" && BigInt.asIntN(64, value) === value) return value;
  if (base === "bool" && typeof value === "boolean") return value;
  if (base === "text" && typeof value === "string") return value;
  const extension = { cells: 1, matrix: 1, string: 2 }[base];
  if (extension !== undefined && value instanceof Extension && value.type === extension) return value;
  throw new Invalid(`${String(value)} is not of type ${type}`);
}

/** A value that a program gives, as it is sent: a whole number is accepted as `int`. */
function written(value, type) {
  if (type.startsWith("list of ") && Array.isArray(value)) {
    return value.map((item) => written(item, type.slice("list of ".length)));
  }
  const isInt = type === "int" || type.startsWith("int ");
  return read(isInt && Number.isSafeInteger(value) ? BigInt(value) : value, type);
}

/** Values in the order of the vocabulary as an object by field. */
export function readValues(plain, fields) {
  if (!Array.isArray(plain) || plain.length !== fields.length) throw new Invalid("wrong number of values");
  return Object.fromEntries(fields.map(([name, type], n) => [name, read(plain[n], type)]));
}

/** Values by field as they are sent; `what` has them. */
export function writeValues(values, fields, what) {
  const known = fields.map(([name]) => name);
  const extra = Object.keys(values).find((name) => !known.includes(name));
  if (extra !== undefined) throw new Invalid(`${what} has no ${extra}; it has ${known.join(", ") || "no values"}`);
  return fields.map(([name, type]) => {
    if (values[name] === undefined) throw new Invalid(`${what} needs a value for ${name} (${type})`);
    try {
      return written(values[name], type);
    } catch (error) {
      throw error instanceof Invalid ? new Invalid(`${name} of ${what}: ${error.message}`) : error;
    }
  });
}
