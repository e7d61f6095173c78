/** Digests of strings: equal exactly if the strings have the same text (docs/reference/protocol/digests.md). */

import { blake2b, hex } from "./blake2b.js";
import { levelsOf, MANY, runs } from "./columns.js";
import { decode, Extension } from "./msgpack.js";
import { readString } from "./scene.js";
import { writeValues } from "./vocabulary.js";

const SIZE = 16; // bytes
const CHUNK = 4096; // values
const WHOLE = 10n ** 16n;
const encoder = new TextEncoder();

const hash = (...parts) => blake2b(joined(parts.map((part) => (typeof part === "string" ? encoder.encode(part) : part))), SIZE);

function joined(parts) {
  const result = new Uint8Array(parts.reduce((size, part) => size + part.length, 0));
  let at = 0;
  for (const part of parts) {
    result.set(part, at);
    at += part.length;
  }
  return result;
}

/** The digest of a string, 32 hexadecimal digits as in a run's summary. */
export function digest(nodes, vocabulary) {
  return hex(digestOf(nodes, vocabulary));
}

function digestOf(nodes, vocabulary) {
  // A stack of scopes in progress, because strings may be deep.
  const open = [new Scope(null, nodes, vocabulary)];
  for (;;) {
    const scope = open.at(-1);
    const inner = scope.next();
    if (inner !== null) open.push(new Scope(inner, inner.scope, vocabulary));
    else if (open.length === 1) return hash(...scope.digests);
    else {
      open.pop();
      open.at(-1).digests.push(hash(head(scope.node, vocabulary), "\0", hash(...scope.digests)));
    }
  }
}

/** A scope, and the digests of the parts that have been hashed so far. */
class Scope {
  digests = [];

  constructor(node, nodes, vocabulary) {
    Object.assign(this, { node, vocabulary });
    const isRun = ([shape, run]) => shape !== null && run.length >= MANY;
    this.parts = runs(nodes, vocabulary).flatMap((group) => (isRun(group) ? [group[1]] : group[1]));
    this.at = 0;
  }

  /** Hashes parts up to the next node with a scope, and returns this node, or null after the last part. */
  next() {
    while (this.at < this.parts.length) {
      const part = this.parts[this.at++];
      if (Array.isArray(part)) this.digests.push(digestOfRun(part, this.vocabulary));
      else if (part.scope !== undefined) return part;
      else this.digests.push(hash(head(part, this.vocabulary), "\0"));
    }
    return null;
  }
}

/** The text of a node without its scope. */
function head({ symbol, id, values }, vocabulary) {
  const fields = vocabulary.fields(symbol);
  const plain = writeValues(values, fields, symbol);
  const texts = fields.map(([name, type], n) => `${name}=${text(plain[n], type, vocabulary)}`);
  return `${symbol}${id === undefined ? "" : `#${id}`}${texts.length > 0 ? `<${texts.join(", ")}>` : ""}`;
}

/** A value as it is in the text of a node. */
export function text(value, type, vocabulary) {
  if (typeof value === "number" || type.startsWith("real")) return realText(Number(value));
  if (typeof value === "string") return JSON.stringify(value);
  if (Array.isArray(value)) return `[${value.map((item) => text(item, type.slice("list of ".length), vocabulary)).join(", ")}]`;
  if (!(value instanceof Extension)) return `${value}`;
  if (value.type === 2) return `{#${digest(readString(decode(value.data), vocabulary), vocabulary)}}`;
  const view = new DataView(value.data.buffer, value.data.byteOffset);
  const letter = value.data[0] === 0x72 ? "r" : "";
  return `${view.getUint32(1, true)}x${view.getUint32(5, true)}${letter}[#${hex(hash(value.data.subarray(9)))}]`;
}

/** The shortest decimal number that reads back as the same float64. */
function realText(value) {
  if (Object.is(value, -0)) return "-0.0";
  const [mantissa, exponent] = value.toExponential().split("e");
  const power = Number(exponent);
  if (value !== 0 && (power < -4 || power >= 16)) {
    return `${mantissa}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
  }
  // From 1e-4 to 1e16, with the digits of the shortest form.
  const digits = mantissa.replace(/[-.]/g, "");
  const sign = value < 0 ? "-" : "";
  if (power < 0) return `${sign}0.${"0".repeat(-power - 1)}${digits}`;
  const whole = digits.slice(0, power + 1).padEnd(power + 1, "0");
  const rest = digits.slice(power + 1);
  return rest === "" ? `${sign}${whole}` : `${sign}${whole}.${rest}`;
}

function digestOfRun(nodes, vocabulary) {
  const parts = levelsOf(nodes).flatMap((level) => {
    const [{ symbol, id }] = level;
    const fields = vocabulary.fields(symbol);
    const rows = level.map(({ values }) => writeValues(values, fields, symbol));
    const columns = fields.map((_, n) => digestOfColumn(rows.map((row) => row[n])));
    const ids = id === undefined ? [] : [digestOfColumn(level.map((node) => node.id), "ids")];
    return [`${symbol}<${fields.map(([name]) => name).join(",")}>\0`, ...ids, ...columns];
  });
  return hash(`${nodes.length}\0`, ...parts);
}

/** The digest of a column; ids are texts without quotes. */
function digestOfColumn(values, kind = "values") {
  const chunks = [];
  for (let at = 0; at < values.length; at += CHUNK) chunks.push(digestOfChunk(values.slice(at, at + CHUNK), kind));
  return hash(...chunks);
}

function digestOfChunk(values, kind) {
  if (kind === "ids") return hash(`t${values.join("\n")}\n`);
  if (values.every(isExact)) {
    const view = new DataView(new ArrayBuffer(8 * values.length));
    values.forEach((value, n) => view.setFloat64(8 * n, Number(value), true));
    return hash("n", new Uint8Array(view.buffer));
  }
  if (typeof values[0] === "boolean") return hash("b", Uint8Array.from(values, Number));
  return hash("t", values.map((value) => `${text(value, "")}\n`).join(""));
}

/** Whether float64 has a number, and its text is that of the float64. */
function isExact(value) {
  if (typeof value === "number") return true;
  return typeof value === "bigint" && value > -WHOLE && value < WHOLE && BigInt(Number(value)) === value;
}
