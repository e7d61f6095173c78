/**
 * Strings and events: nodes are plain objects, values are checked against the vocabulary.
 *
 * A figure is `{symbol, values}`, a transformation has a `scope` besides, an agent an `id` as well.
 * `values` is an object by parameter: reals are numbers, `int` is BigInt.
 */

import { condition as check } from "./condition.js";
import { decode, encode, Extension, Invalid } from "./msgpack.js";
import { blake2b } from "./random.js";

const ID = /^[A-Za-z0-9_][A-Za-z0-9_:-]*$/;
const LONGEST_ID = 64;

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

/** Measures of a form are reals, whatever number a message has. */
function numbers(form) {
  if (Array.isArray(form)) return form.map(numbers);
  return typeof form === "bigint" ? Number(form) : form;
}

function unknown(name) {
  throw new Invalid(`the world's vocabulary has no ${String(name)}`);
}

/** A value from a message as a value of the type. */
function read(value, type) {
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

function readValues(plain, fields) {
  if (!Array.isArray(plain) || plain.length !== fields.length) throw new Invalid("wrong number of values");
  return Object.fromEntries(fields.map(([name, type], n) => [name, read(plain[n], type)]));
}

function writeValues(values, fields, what) {
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

/** The nodes of a string as it is in a message; columns are refused, because the member is `plain`. */
export function readString(flat, vocabulary) {
  if (!Array.isArray(flat) || typeof flat[0] !== "bigint") throw new Invalid("not a string");
  const top = [];
  // Scopes that still lack nodes, from outside to inside: a stack, because strings may be deep.
  const open = [{ scope: top, missing: Number(flat[0]) }];
  const close = () => {
    while (open.length > 0 && open.at(-1).missing === 0) open.pop();
  };
  close();
  for (const piece of flat.slice(1)) {
    if (open.length === 0) throw new Invalid("a string has data after its end");
    const { node, count } = readNode(piece, vocabulary);
    open.at(-1).scope.push(node);
    open.at(-1).missing -= 1;
    if (count > 0) open.push({ scope: node.scope, missing: count });
    close();
  }
  if (open.length > 0) throw new Invalid("a string is cut off");
  return top;
}

function readNode(piece, vocabulary) {
  if (!Array.isArray(piece) || typeof piece[0] !== "string") throw new Invalid("not a node");
  const [symbol, ...rest] = piece;
  const expected = { P: 1, T: 2, A: 3 }[symbol[0]];
  if (rest.length !== expected) throw new Invalid(`not a node of ${symbol}`);
  const fields = vocabulary.fields(symbol);
  if (expected === 1) return { node: { symbol, values: readValues(rest[0], fields) }, count: 0 };
  const count = rest.at(-1);
  if (typeof count !== "bigint" || count < 0n) throw new Invalid("not a count");
  const scope = [];
  if (expected === 2) return { node: { symbol, values: readValues(rest[0], fields), scope }, count: Number(count) };
  const [id, plain] = rest;
  // The slot of a part of a population has the name of the part, which is no id.
  if (typeof id !== "string" || (plain !== null && !ID.test(id))) throw new Invalid(`${String(id)} is not an id`);
  const values = plain === null ? null : readValues(plain, fields);
  return { node: { symbol, id, values, scope }, count: Number(count) };
}

/** Nodes as they are in a message. */
export function writeString(nodes, vocabulary) {
  const flat = [BigInt(nodes.length)];
  const waiting = [...nodes].reverse();
  while (waiting.length > 0) {
    const { symbol, id, values, scope } = waiting.pop();
    const name = id === undefined ? symbol : `${symbol}#${id}`;
    const plain = values === null ? null : writeValues(values ?? {}, vocabulary.fields(symbol), name);
    const piece = id === undefined ? [symbol, plain] : [symbol, id, plain];
    if (scope !== undefined) piece.push(BigInt(scope.length));
    flat.push(piece);
    for (let n = (scope?.length ?? 0) - 1; n >= 0; n--) waiting.push(scope[n]);
  }
  return flat;
}

/** Whether two strings are the same to the last bit. */
export function same(a, b, vocabulary) {
  const [left, right] = [a, b].map((nodes) => encode(writeString(nodes, vocabulary)));
  return left.length === right.length && left.every((byte, n) => byte === right[n]);
}

/** The nodes of a value of type `string`. */
export function unpacked(extension, vocabulary) {
  return readString(decode(extension.data), vocabulary);
}

/** A figure, such as `figure("PBar", {length: 2})`. */
export function figure(symbol, values = {}) {
  return { symbol, values };
}

/** A transformation of nodes. */
export function transformation(symbol, values, scope) {
  return { symbol, values, scope };
}

/** An event; `to` are ids of receivers, and no ids stand for all agents that subscribe to its type. */
export function event(type, values = {}, { condition = "", sender = "", to = [] } = {}) {
  return { type, values, condition, sender, receivers: [...new Set(to)].sort() };
}

export function readEvent(plain, vocabulary) {
  if (!Array.isArray(plain) || ![2, 5].includes(plain.length)) throw new Invalid("not an event");
  const [type, values, condition = "", sender = "", receivers = []] = plain;
  if (typeof condition !== "string" || typeof sender !== "string") throw new Invalid("not an event");
  if (!Array.isArray(receivers) || !receivers.every((id) => typeof id === "string")) {
    throw new Invalid("receivers that are no ids");
  }
  check(condition);
  return { type, values: readValues(values, vocabulary.eventFields(type)), condition, sender, receivers };
}

export function writeEvent({ type, values, condition, sender, receivers }, vocabulary) {
  const short = [type, writeValues(values, vocabulary.eventFields(type), type)];
  return condition || sender || receivers.length > 0 ? [...short, condition, sender, receivers] : short;
}

/** The id of a newborn of an agent. */
export function childId(parent, births) {
  return derived(parent, `${births}`, "");
}

/** The id of a copy, from 2, in a frame of a literal world; `height` is above 1 for agents in its scope. */
export function copyId(id, frame, copy, height) {
  return derived(id, `${frame}-${copy}${height > 1 ? `-${height}` : ""}`, `${frame}`);
}

function derived(id, mark, before) {
  const long = `${id}:${mark}`;
  if (long.length <= LONGEST_ID) return long;
  const digest = [...blake2b(long, 12)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  return `${id.slice(0, 16).split(":")[0]}:${before}-${digest}`;
}
