/**
 * Columns: neighbours of one shape and events of one type, value by value (PROTOCOL.md, P3.15 to P3.19).
 *
 * In this package they are single nodes and single events; columns exist only in messages.
 */

import { areIds, LONGEST_ID, readArray, readIds, writeArray, writeIds } from "./arrays.js";
import { Invalid } from "./msgpack.js";
import { areFlat, read } from "./vocabulary.js";

/** The least number of neighbours that are worth columns. */
export const MANY = 32;
const MOST_LEVELS = 8;
const MOST_ROWS = 5_000_000;

/** The values of a column, `count` of a type. */
export function readColumn(plain, type, count) {
  const values = areIds(plain) ? readIds(plain, count) : Array.isArray(plain) ? plain : readArray(plain);
  if (values.length !== count) throw new Invalid(`a column of ${values.length} values, not ${count}`);
  return values.map((value) => read(value, type));
}

/** Values of a type as a column. */
export const writeColumn = (values, type) => (type.startsWith("text") ? values : writeArray(values));

/** A number of rows. */
export function readCount(plain) {
  if (typeof plain !== "bigint" || plain < 1n || plain > MOST_ROWS) throw new Invalid("not a count of rows");
  return Number(plain);
}

/** The symbols of nodes that can be in columns together, from outside to inside, as one text; or null. */
export function shapeOf(node, vocabulary) {
  if (node.id !== undefined && (node.scope.length > 0 || node.id.length > LONGEST_ID)) return null;
  const symbols = [];
  for (let inner = node; ; [inner] = inner.scope) {
    if (symbols.length === MOST_LEVELS || !areFlat(vocabulary.fields(inner.symbol))) return null;
    if (inner !== node && inner.id !== undefined) return null;
    symbols.push(inner.symbol);
    const size = inner.scope?.length ?? 0;
    if (size === 0) return symbols.join(" ");
    if (size > 1) return null;
  }
}

/** The common shape of nodes, or null. */
export function commonShape(nodes, vocabulary) {
  const shape = nodes.length === 0 ? null : shapeOf(nodes[0], vocabulary);
  return nodes.every((node) => shapeOf(node, vocabulary) === shape) ? shape : null;
}

/** Nodes in maximal runs of one shape: pairs of shape, or null, and nodes. */
export function runs(nodes, vocabulary) {
  const result = [];
  for (const node of nodes) {
    const shape = shapeOf(node, vocabulary);
    if (result.length > 0 && result.at(-1)[0] === shape) result.at(-1)[1].push(node);
    else result.push([shape, [node]]);
  }
  return result;
}

/** The nodes of each level: level 0 is the nodes themselves. */
export function levelsOf(nodes) {
  const levels = [nodes];
  while ((levels.at(-1)[0].scope?.length ?? 0) > 0) levels.push(levels.at(-1).map((node) => node.scope[0]));
  return levels;
}

/** Columns as nodes. */
export function readColumns(plain, vocabulary) {
  const [count, ids, levels] = plain;
  const rows = readCount(count);
  if (!Array.isArray(levels) || levels.length < 1 || levels.length > MOST_LEVELS) throw new Invalid("levels of columns");
  const outermost = readLevel(levels[0], rows, vocabulary);
  const hasIds = outermost[0].symbol.startsWith("A");
  if (hasIds !== (ids !== null) || (hasIds && levels.length > 1)) throw new Invalid("ids of columns");
  let scopes = null;
  for (let depth = levels.length - 1; depth >= 0; depth--) {
    const nodes = depth === 0 ? outermost : readLevel(levels[depth], rows, vocabulary);
    const isFigure = nodes[0].symbol.startsWith("P");
    if (depth > 0 && nodes[0].symbol.startsWith("A")) throw new Invalid("agents in columns of transformations");
    if (isFigure && scopes !== null) throw new Invalid("a figure with a scope");
    if (!isFigure) nodes.forEach((node, n) => (node.scope = scopes === null ? [] : [scopes[n]]));
    scopes = nodes;
  }
  return hasIds ? named(scopes, readIds(ids, rows)) : scopes;
}

function named(nodes, ids) {
  if (new Set(ids).size < ids.length) throw new Invalid("equal ids in columns");
  return nodes.map(({ symbol, values, scope }, n) => ({ symbol, id: ids[n], values, scope }));
}

function readLevel(plain, count, vocabulary) {
  if (!Array.isArray(plain) || plain.length !== 2 || typeof plain[0] !== "string") throw new Invalid("not a level of columns");
  const [symbol, columns] = plain;
  const rows = readRowsOf(columns, vocabulary.fields(symbol), count);
  return rows.map((values) => ({ symbol, values }));
}

/** The values of each row by field. */
function readRowsOf(columns, fields, count) {
  if (!Array.isArray(columns) || columns.length !== fields.length) throw new Invalid("wrong number of columns");
  const read = fields.map(([name, type], n) => [name, readColumn(columns[n], type, count)]);
  return Array.from({ length: count }, (_, row) => Object.fromEntries(read.map(([name, column]) => [name, column[row]])));
}

/** Nodes of one shape as columns; `valuesOf` checks and writes the values of a node. */
export function writeColumns(nodes, vocabulary, valuesOf) {
  const levels = levelsOf(nodes).map((level) => {
    const rows = level.map(valuesOf);
    const fields = vocabulary.fields(level[0].symbol);
    return [level[0].symbol, fields.map(([, type], n) => writeColumn(rows.map((row) => row[n]), type))];
  });
  const ids = nodes[0].id === undefined ? null : writeIds(nodes.map(({ id }) => id));
  return [BigInt(nodes.length), ids, levels];
}

/** A batch of events as single events. */
export function readBatch([type, count, columns, condition, senders, receivers], vocabulary) {
  const size = readCount(count);
  const rows = readRowsOf(columns, vocabulary.eventFields(type), size);
  const from = senders === null ? null : readIds(senders, size);
  const to = receivers === null ? null : readIds(receivers, size);
  return rows.map((values, n) => ({ type, values, condition, sender: from?.[n] ?? "", receivers: to === null ? [] : [to[n]] }));
}

/** Events with one type and condition, all or none with a sender and with one receiver, as a batch. */
export function writeBatch(events, rows, vocabulary) {
  const [{ type, condition, sender, receivers }] = events;
  const columns = vocabulary.eventFields(type).map(([, kind], n) => writeColumn(rows.map((row) => row[n]), kind));
  const senders = sender === "" ? null : writeIds(events.map((event) => event.sender));
  const to = receivers.length === 0 ? null : writeIds(events.map((event) => event.receivers[0]));
  return [type, BigInt(events.length), columns, condition, senders, to];
}
