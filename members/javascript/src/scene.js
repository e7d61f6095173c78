/**
 * Strings and events: nodes are plain objects, values are checked against the vocabulary.
 *
 * A figure is `{symbol, values}`, a transformation has a `scope` besides, an agent an `id` as well.
 * `values` is an object by parameter: reals are numbers, `int` is BigInt.
 */

import { isId, LONGEST_ID } from "./arrays.js";
import { blake2b, hex } from "./blake2b.js";
import { MANY, readBatch, readColumns, runs, writeBatch, writeColumns } from "./columns.js";
import { condition as check } from "./condition.js";
import { decode, encode, Invalid } from "./msgpack.js";
import { areFlat, readValues, writeValues } from "./vocabulary.js";

/** The nodes of a string as it is in a message; columns become single nodes. */
export const readString = (flat, vocabulary) => readPieces(flat, vocabulary, false);

/** The nodes of a skeleton: its agents are slots, with null as values. */
export const readSkeleton = (flat, vocabulary) => readPieces(flat, vocabulary, true);

function readPieces(flat, vocabulary, hasSlots) {
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
    const { nodes, count } = readPiece(piece, vocabulary, hasSlots);
    for (const node of nodes) open.at(-1).scope.push(node);
    open.at(-1).missing -= 1;
    if (count > 0) open.push({ scope: nodes[0].scope, missing: count });
    close();
  }
  if (open.length > 0) throw new Invalid("a string is cut off");
  return top;
}

/** The nodes of a piece, and the number of pieces in the scope of the only one. */
function readPiece(piece, vocabulary, hasSlots) {
  if (!Array.isArray(piece)) throw new Invalid("not a node");
  if (typeof piece[0] === "bigint" && piece.length === 3) return { nodes: readColumns(piece, vocabulary), count: 0 };
  const { node, count } = readNode(piece, vocabulary, hasSlots);
  return { nodes: [node], count };
}

function readNode(piece, vocabulary, hasSlots) {
  if (typeof piece[0] !== "string") throw new Invalid("not a node");
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
  const isSlot = hasSlots && plain === null;
  if (typeof id !== "string" || !(isSlot || isId(id))) throw new Invalid(`${String(id)} is not an id`);
  // An agent without attributes has nil in place of its values, too.
  const values = isSlot ? null : readValues(plain === null && fields.length === 0 ? [] : plain, fields);
  return { node: { symbol, id, values, scope }, count: Number(count) };
}

/** The values of a node as they are sent. */
function writtenValues({ symbol, id, values }, vocabulary) {
  return writeValues(values, vocabulary.fields(symbol), id === undefined ? symbol : `${symbol}#${id}`);
}

/** Nodes as they are in a message; `many` neighbours of one shape and more are columns. */
export function writeString(nodes, vocabulary, many = MANY) {
  const flat = [];
  const waiting = [...pieces(nodes, vocabulary, many)].reverse();
  flat.push(BigInt(waiting.length));
  while (waiting.length > 0) {
    const piece = waiting.pop();
    if (Array.isArray(piece)) flat.push(writeColumns(piece, vocabulary, (node) => writtenValues(node, vocabulary)));
    else {
      const { symbol, id, scope } = piece;
      const values = writtenValues(piece, vocabulary);
      const inner = scope === undefined ? [] : pieces(scope, vocabulary, many);
      const count = scope === undefined ? [] : [BigInt(inner.length)];
      const plain = id !== undefined && values.length === 0 ? null : values;
      flat.push(id === undefined ? [symbol, plain, ...count] : [symbol, id, plain, ...count]);
      for (let n = inner.length - 1; n >= 0; n--) waiting.push(inner[n]);
    }
  }
  return flat;
}

/** Nodes with longer runs as lists. */
function pieces(nodes, vocabulary, many) {
  if (nodes.length < many) return nodes;
  return runs(nodes, vocabulary).flatMap(([shape, run]) => (shape === null || run.length < many ? run : [run]));
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

/** Events as they are in a message: single ones and batches. */
export function readEvents(plain, vocabulary) {
  return plain.flatMap((one) => (Array.isArray(one) && one.length === 6 ? checkedBatch(one, vocabulary) : [readEvent(one, vocabulary)]));
}

function checkedBatch(plain, vocabulary) {
  if (typeof plain[3] !== "string") throw new Invalid("not a batch of events");
  check(plain[3]);
  return readBatch(plain, vocabulary);
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

/** Events as they are sent; longer runs of one type and condition as batches. */
export function writeEvents(events, vocabulary) {
  const groups = [];
  for (const event of events) {
    const [plain, likeness] = [writeEvent(event, vocabulary), likenessOf(event, vocabulary)];
    if (groups.length === 0 || likeness === null || groups.at(-1).likeness !== likeness) groups.push({ likeness, events: [], plain: [] });
    groups.at(-1).events.push(event);
    groups.at(-1).plain.push(plain);
  }
  const written = ({ events, plain }) => [writeBatch(events, plain.map(([, values]) => values), vocabulary)];
  return groups.flatMap((group) => (group.events.length < MANY ? group.plain : written(group)));
}

/** What events of one batch have in common, as a text; null for an event that is in none. */
function likenessOf({ type, condition, sender, receivers }, vocabulary) {
  const isNamed = [sender, ...receivers].every((id) => id === "" || (isId(id) && id.length <= LONGEST_ID));
  if (receivers.length > 1 || !isNamed || !areFlat(vocabulary.eventFields(type))) return null;
  return [type, receivers.length, sender === "", condition].join(" ");
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
  return `${id.slice(0, 16).split(":")[0]}:${before}-${hex(blake2b(long, 12))}`;
}
