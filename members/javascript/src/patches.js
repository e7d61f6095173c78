/** Patches of columns: what has changed between two states of nodes of one shape (PROTOCOL.md, P3.20 and P3.21). */

import { readIds, readRows, writeIds, writeRows } from "./arrays.js";
import { commonShape, levelsOf, readColumn, readCount, writeColumn } from "./columns.js";
import { Invalid } from "./msgpack.js";
import { writeValues } from "./vocabulary.js";

const PATCH = "patch";

/** Whether a part of a message is a patch, not a string. */
export const isPatch = (plain) => Array.isArray(plain) && plain[0] === PATCH;

/** The nodes after a patch; those before it remain as they are. */
export function applyPatch(nodes, plain, vocabulary) {
  const [, plainCount, symbols, changes, ...turnover] = plain;
  if (![4, 7].includes(plain.length) || !Array.isArray(symbols) || !Array.isArray(changes)) throw new Invalid("not a patch");
  const shape = nodes === undefined ? null : commonShape(nodes, vocabulary);
  if (shape === null || nodes.length !== readCount(plainCount) || shape !== symbols.join(" ")) {
    throw new Invalid("a patch that does not fit");
  }
  const patched = new Patched(nodes, symbols, vocabulary);
  if (turnover.length > 0) patched.turnOver(...turnover);
  for (const change of changes) patched.change(change);
  return patched.result();
}

/** Nodes while a patch is applied: a row is copied when it first changes. */
class Patched {
  #born = [];
  #copied = new Set();

  constructor(nodes, symbols, vocabulary) {
    Object.assign(this, { rows: [...nodes], symbols, vocabulary });
  }

  turnOver(plainGone, plainBorn, plainIds) {
    const gone = new Set(readRows(plainGone, this.rows.length));
    const rest = this.rows.filter((_, row) => !gone.has(row));
    const bornCount = readRows(plainBorn, Number.MAX_SAFE_INTEGER).length;
    this.#born = readRows(plainBorn, rest.length + bornCount);
    const isOfAgents = this.symbols[0].startsWith("A");
    if (isOfAgents && bornCount > 0 !== (plainIds !== null)) throw new Invalid("a patch without the ids of newborns");
    const ids = plainIds === null ? [] : readIds(plainIds, bornCount);
    this.rows = [];
    let [left, next] = [0, 0];
    while (this.rows.length < rest.length + bornCount) {
      if (this.#born[next] === this.rows.length) this.rows.push(this.#newborn(ids[next++]));
      else this.rows.push(rest[left++]);
    }
    if (this.rows.length === 0) throw new Invalid("a patch that leaves no row");
    if (isOfAgents && new Set(this.rows.map(({ id }) => id)).size < this.rows.length) throw new Invalid("equal ids in a patch");
  }

  #newborn(id) {
    const nodes = this.symbols.map((symbol) => (symbol.startsWith("P") ? { symbol, values: {} } : { symbol, values: {}, scope: [] }));
    for (let depth = 1; depth < nodes.length; depth++) nodes[depth - 1].scope.push(nodes[depth]);
    return id === undefined ? nodes[0] : { id, ...nodes[0] };
  }

  change(plain) {
    if (!Array.isArray(plain) || plain.length !== 4) throw new Invalid("not a change");
    const [level, place, plainRows, plainColumn] = plain;
    const symbol = this.symbols[Number(level)];
    const field = symbol === undefined ? undefined : this.vocabulary.fields(symbol)[Number(place)];
    if (field === undefined) throw new Invalid("a change of no column");
    const rows = plainRows === null ? [...this.rows.keys()] : readRows(plainRows, this.rows.length);
    const column = readColumn(plainColumn, field[1], rows.length);
    rows.forEach((row, n) => (this.#writable(row, Number(level)).values[field[0]] = column[n]));
  }

  #writable(row, level) {
    if (!this.#copied.has(row)) {
      this.rows[row] = copied(this.rows[row]);
      this.#copied.add(row);
    }
    let node = this.rows[row];
    for (let depth = 0; depth < level; depth++) [node] = node.scope;
    return node;
  }

  result() {
    for (const row of this.#born) {
      for (const [{ symbol, values }] of levelsOf([this.rows[row]])) {
        const isWhole = this.vocabulary.fields(symbol).every(([name]) => values[name] !== undefined);
        if (!isWhole) throw new Invalid("a patch without all values of a newborn");
      }
    }
    return this.rows;
  }
}

function copied(node) {
  const copy = { ...node, values: { ...node.values } };
  return node.scope === undefined ? copy : { ...copy, scope: node.scope.map(copied) };
}

/**
 * The patch from nodes to others; null where there is none, because the nodes have no common shape
 * or have another order. The keys identify rows: equal keys stand for the same row.
 */
export function difference(before, after, vocabulary, keysBefore, keysAfter) {
  const shape = commonShape(before, vocabulary);
  if (shape === null || shape !== commonShape(after, vocabulary)) return null;
  const turnover = turnoverOf(keysBefore, keysAfter);
  if (turnover === null) return null;
  const changes = changesOf(before, after, turnover.origins, vocabulary);
  const patch = [PATCH, BigInt(before.length), shape.split(" "), changes];
  const { gone, born } = turnover;
  if (gone.length === 0 && born.length === 0) return patch;
  const ids = born.length === 0 || after[0].id === undefined ? null : writeIds(born.map((row) => after[row].id));
  return [...patch, writeRows(gone), writeRows(born), ids];
}

/** Whether a patch changes nothing. */
export const isEmpty = (patch) => patch.length === 4 && patch[3].length === 0;

/** The rows that are gone and born, and for each row after it the one before it, or -1; null for another order. */
function turnoverOf(before, after) {
  const places = new Map(before.map((key, row) => [key, row]));
  const origins = after.map((key) => places.get(key) ?? -1);
  const kept = origins.filter((row) => row >= 0);
  if (kept.some((row, n) => n > 0 && kept[n - 1] >= row)) return null;
  const remaining = new Set(kept);
  const gone = [...before.keys()].filter((row) => !remaining.has(row));
  const born = [...after.keys()].filter((row) => origins[row] < 0);
  return { origins, gone, born };
}

function changesOf(before, after, origins, vocabulary) {
  const different = [...after.keys()].filter((row) => before[origins[row]] !== after[row]);
  if (different.length === 0) return [];
  const levelsAfter = levelsOf(different.map((row) => after[row]));
  const levelsBefore = levelsOf(before);
  return levelsAfter.flatMap((level, depth) => {
    const fields = vocabulary.fields(level[0].symbol);
    const written = ({ id, symbol, values }) => writeValues(values, fields, id ?? symbol);
    const rows = level.map(written);
    const olds = different.map((row) => (origins[row] < 0 ? [] : written(levelsBefore[depth][origins[row]])));
    return fields.flatMap(([, type], place) => {
      const places = [...rows.keys()].filter((n) => !Object.is(olds[n][place], rows[n][place]));
      if (places.length === 0) return [];
      const isWhole = places.length === after.length;
      const column = writeColumn(places.map((n) => rows[n][place]), type);
      return [[BigInt(depth), BigInt(place), isWhole ? null : writeRows(places.map((n) => different[n])), column]];
    });
  });
}
