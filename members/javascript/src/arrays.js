/** Arrays of numbers and bools, and ids of agents, as they are in columns (PROTOCOL.md, P3.17 and P3.18). */

import { Extension, Invalid } from "./msgpack.js";

const ARRAY = 3;
export const LONGEST_ID = 64; // characters
const ID = /^[A-Za-z0-9_][A-Za-z0-9_:-]*$/;
const NUMBERED = /^(.*?)(0|[1-9]\d{0,14})$/;
const encoder = new TextEncoder();

/** The types of arrays: bytes of a value, and how one is read and written. */
const TYPES = {
  d: [8, (view, at) => view.getFloat64(at, true), (view, at, value) => view.setFloat64(at, value, true)],
  b: [1, (view, at) => BigInt(view.getInt8(at)), (view, at, value) => view.setInt8(at, Number(value))],
  h: [2, (view, at) => BigInt(view.getInt16(at, true)), (view, at, value) => view.setInt16(at, Number(value), true)],
  i: [4, (view, at) => BigInt(view.getInt32(at, true)), (view, at, value) => view.setInt32(at, Number(value), true)],
  q: [8, (view, at) => view.getBigInt64(at, true), (view, at, value) => view.setBigInt64(at, value, true)],
  "?": [1, (view, at) => bool(view.getUint8(at)), (view, at, value) => view.setUint8(at, value ? 1 : 0)],
};

function bool(byte) {
  if (byte > 1) throw new Invalid("a bool in a column that is neither 0 nor 1");
  return byte === 1;
}

export const isId = (text) => typeof text === "string" && ID.test(text);

/** The values of an array: numbers, BigInts or bools. */
export function readArray(plain) {
  if (!(plain instanceof Extension) || plain.type !== ARRAY || plain.data.length === 0) throw new Invalid("not a column");
  const { data } = plain;
  const type = TYPES[String.fromCharCode(data[0])];
  if (type === undefined) throw new Invalid("a column of an unknown type");
  const [width, get] = type;
  if ((data.length - 1) % width !== 0) throw new Invalid("a column that is cut off");
  const view = new DataView(data.buffer, data.byteOffset + 1, data.length - 1);
  return Array.from({ length: (data.length - 1) / width }, (_, n) => get(view, n * width));
}

/** Values as an array: BigInts in the narrowest type that holds them all, numbers as float64. */
export function writeArray(values) {
  const letter = typeof values[0] === "number" ? "d" : typeof values[0] === "boolean" ? "?" : narrowest(values);
  const [width, , set] = TYPES[letter];
  const data = new Uint8Array(1 + width * values.length);
  const view = new DataView(data.buffer, 1);
  data[0] = letter.charCodeAt(0);
  values.forEach((value, n) => set(view, n * width, value));
  return new Extension(ARRAY, data);
}

function narrowest(values) {
  const fits = (bits) => values.every((value) => BigInt.asIntN(bits, value) === value);
  return fits(8) ? "b" : fits(16) ? "h" : fits(32) ? "i" : "q";
}

/** Ascending row numbers below a count. */
export function readRows(plain, count) {
  const rows = readArray(plain).map(Number);
  const ascend = rows.every((row, n) => row >= 0 && row < count && Number.isInteger(row) && (n === 0 || rows[n - 1] < row));
  if (!ascend) throw new Invalid("rows that do not ascend");
  return rows;
}

export const writeRows = (rows) => writeArray(rows.map(BigInt));

/** Whether a column is ids; a list of text has text as its second item. */
export const areIds = (plain) => Array.isArray(plain) && [2, 3].includes(plain.length) && typeof plain[1] !== "string";

/** `count` ids. */
export function readIds(plain, count) {
  if (!areIds(plain)) throw new Invalid("not ids");
  const ids = plain[0] === null ? spelled(plain, count) : numbered(plain, count);
  if (ids.length !== count || !ids.every((id) => isId(id) && id.length <= LONGEST_ID)) throw new Invalid("invalid ids");
  return ids;
}

function numbered([stem, first, size], count) {
  if (typeof stem !== "string") throw new Invalid("ids without a stem");
  if (size === undefined) return readArray(first).map((number) => `${stem}${number}`);
  if (typeof first !== "bigint" || first < 0n || size !== BigInt(count)) throw new Invalid("not consecutive ids");
  return Array.from({ length: count }, (_, n) => `${stem}${first + BigInt(n)}`);
}

function spelled([, width, data], count) {
  const size = Number(width);
  const isValid = size >= 1 && size <= LONGEST_ID && data instanceof Uint8Array && data.length === size * count;
  if (!isValid) throw new Invalid("ids of a wrong length");
  const id = (n) => String.fromCharCode(...data.subarray(n * size, (n + 1) * size)).replace(/\0+$/, "");
  return Array.from({ length: count }, (_, n) => id(n));
}

/** Ids in the shortest of the three forms. */
export function writeIds(ids) {
  const parts = ids.map((id) => NUMBERED.exec(id));
  const stem = parts[0]?.[1];
  if (stem === undefined || !parts.every((part) => part?.[1] === stem)) return spelledOut(ids);
  const numbers = parts.map(([, , number]) => BigInt(number));
  const isConsecutive = numbers.every((number, n) => number === numbers[0] + BigInt(n));
  return isConsecutive ? [stem, numbers[0], BigInt(ids.length)] : [stem, writeArray(numbers)];
}

function spelledOut(ids) {
  const width = Math.max(1, ...new Set(ids.map((id) => id.length)));
  const data = new Uint8Array(width * ids.length);
  ids.forEach((id, n) => data.set(encoder.encode(id), n * width));
  return [null, BigInt(width), data];
}
