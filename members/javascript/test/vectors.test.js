/** The vectors in protocol/vectors that concern this package. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";

import { readIds, writeIds } from "../src/arrays.js";
import { condition } from "../src/condition.js";
import { digest, text } from "../src/digest.js";
import { decode, encode, Extension, Invalid } from "../src/msgpack.js";
import { applyPatch, difference, isEmpty } from "../src/patches.js";
import { agentStream, hashOf, Philox } from "../src/random.js";
import { copyId, readEvents, readString, writeEvent, writeEvents, writeString } from "../src/scene.js";
import { Vocabulary } from "../src/vocabulary.js";

const FOLDER = new URL("../../../protocol/vectors/", import.meta.url);
const load = (name) => JSON.parse(readFileSync(new URL(`${name}.json`, FOLDER), "utf8"));
const bytes = (digits) => Uint8Array.from(Buffer.from(digits, "hex"));
const hex = (data) => Buffer.from(data).toString("hex");
const bits = (number) => hex(encode(number)).slice(2);
const real = (digits) => decode(bytes(`cb${digits}`));

/** Plain data from the notation of docs/reference/protocol/test-vectors.md. */
function untagged(noted) {
  if (Array.isArray(noted)) return noted.map(untagged);
  if (typeof noted === "number") return BigInt(noted);
  if (noted === null || typeof noted !== "object") return noted;
  if ("int" in noted) return BigInt(noted.int);
  if ("float" in noted) return real(noted.float);
  if ("ext" in noted) return new Extension(noted.ext, bytes(noted.bytes));
  if ("bytes" in noted) return bytes(noted.bytes);
  return new Map(noted.map.map(([key, value]) => [key, untagged(value)]));
}

function each(file, check) {
  const document = load(file);
  assert.ok(document.cases.length > 0);
  for (const { name, input, expected } of document.cases) {
    test(`${file}: ${name}`, () => check(input, expected, document));
  }
}

each("floats", (input, expected) => {
  assert.equal(hex(encode(real(input))), expected.msgpack);
  assert.equal(text(real(input), "real"), expected.text);
});

each("integers", (input, expected) => {
  assert.equal(hex(encode(BigInt(input))), expected.msgpack);
  assert.equal(decode(bytes(expected.msgpack)), BigInt(input));
  assert.equal(decode(bytes(expected.accepted)), BigInt(input));
  assert.equal(text(BigInt(input), "int"), expected.text);
});

each("texts", (input, expected) => {
  const value = String.fromCodePoint(...input);
  assert.equal(hex(encode(value)), expected.msgpack);
  assert.equal(decode(bytes(expected.msgpack)), value);
  assert.equal(text(value, "text"), expected.text);
});

for (const file of ["messages", "readings"]) {
  each(file, (input, expected) => {
    const data = bytes(input.msgpack ?? input);
    assert.deepEqual(decode(data), untagged(expected));
    assert.deepEqual(decode(encode(decode(data))), decode(data));
  });
}

each("epochs", (input, expected) => {
  const message = decode(bytes(input.message));
  assert.equal(hex(encode(BigInt(input.epoch), message)), expected);
});

/** The nodes of a string, and its vocabulary. */
function stringOf(data, document) {
  const vocabulary = new Vocabulary(untagged(document.vocabulary));
  return [readString(decode(bytes(data)), vocabulary), vocabulary];
}

/** Single nodes, whatever their number. */
const single = (nodes, vocabulary) => hex(encode(writeString(nodes, vocabulary, Infinity)));

each("strings", (_, expected, document) => {
  const [nodes, vocabulary] = stringOf(expected.msgpack, document);
  assert.equal(single(nodes, vocabulary), expected.msgpack);
  assert.equal(digest(nodes, vocabulary), expected.digest);
});

each("digests", (input, expected, document) => {
  const [nodes, vocabulary] = stringOf(input, document);
  assert.equal(digest(nodes, vocabulary), expected);
});

each("columns", (input, expected, document) => {
  const [nodes, vocabulary] = stringOf(`9201${input}`, document);
  assert.equal(single(nodes, vocabulary), expected.msgpack);
  const written = writeString(nodes, vocabulary, 1);
  assert.equal(written.length, 2);
  assert.equal(single(readString(decode(encode(written)), vocabulary), vocabulary), expected.msgpack);
});

each("ids", (input, expected) => {
  const count = expected.length;
  assert.deepEqual(readIds(decode(bytes(input)), count), expected);
  assert.deepEqual(readIds(decode(encode(writeIds(expected))), count), expected);
});

each("patches", ({ columns, patch }, expected, document) => {
  const [before, vocabulary] = stringOf(`9201${columns}`, document);
  const patched = applyPatch(before, decode(bytes(patch)), vocabulary);
  assert.equal(single(patched, vocabulary), expected.msgpack);
  assert.equal(single(before, vocabulary), single(stringOf(`9201${columns}`, document)[0], vocabulary), "the state before changed");
  const ids = (nodes) => nodes.map(({ id }) => id);
  const own = difference(before, patched, vocabulary, ids(before), ids(patched));
  assert.equal(single(applyPatch(before, decode(encode(own)), vocabulary), vocabulary), expected.msgpack);
  assert.ok(isEmpty(difference(before, before, vocabulary, ids(before), ids(before))));
  assert.throws(() => applyPatch(before.slice(1), decode(bytes(patch)), vocabulary), Invalid);
});

each("values", (_, expected) => {
  assert.equal(hex(encode(decode(bytes(expected.msgpack)))), expected.msgpack);
});

each("events", (input, expected, document) => {
  const vocabulary = new Vocabulary(untagged(document.vocabulary));
  const plain = [decode(bytes(input))];
  if (expected === "refused") return assert.throws(() => readEvents(plain, vocabulary), Invalid);
  const events = readEvents(plain, vocabulary);
  assert.equal(hex(encode(events.map((event) => writeEvent(event, vocabulary)))), expected.msgpack);
});

test("events: many of one type are a batch", () => {
  const vocabulary = new Vocabulary(untagged(load("events").vocabulary));
  const near = (n) => ({ type: "eNear", values: { distance: n }, condition: "x < 5", sender: "", receivers: [`f${n}`] });
  const events = Array.from({ length: 40 }, (_, n) => near(n));
  const plain = decode(encode(writeEvents([...events, { ...near(40), condition: "" }], vocabulary)));
  assert.deepEqual(plain.map((item) => item.length), [6, 5]);
  assert.deepEqual(readEvents(plain, vocabulary).slice(0, 40), events);
});

each("conditions", (input, expected) => {
  const state = Object.fromEntries(untagged(input.state));
  if (expected === "refused") return assert.throws(() => condition(input.condition)(state), Invalid);
  assert.equal(condition(input.condition)(state), expected);
});

each("copies", (input, expected) => {
  assert.equal(copyId(input.id, BigInt(input.frame), input.copy, input.height), expected);
});

each("splitmix64", ({ seed, frame, who }, expected) => {
  const stream = agentStream(seed, frame, who);
  assert.equal(hashOf(who), BigInt(`0x${expected.hash}`));
  assert.equal(stream.word, BigInt(`0x${expected.word}`));
  assert.deepEqual(expected.numbers.map(() => bits(stream.next())), expected.numbers);
});

each("responses", ({ seed, frame, who, event_type: type }, expected) => {
  const stream = agentStream(seed, frame, who, type);
  assert.equal(stream.word, BigInt(`0x${expected.word}`));
  assert.deepEqual(expected.numbers.map(() => bits(stream.next())), expected.numbers);
});

each("philox", ({ seed, who, frame }, expected) => {
  const [stream, again] = [new Philox(seed, who, frame), new Philox(seed, who, frame)];
  assert.deepEqual(stream.key, expected.key.map((word) => BigInt(`0x${word}`)));
  assert.deepEqual(expected.words.map(() => stream.word()), expected.words.map((word) => BigInt(`0x${word}`)));
  assert.deepEqual(expected.numbers.map(() => bits(again.next())), expected.numbers);
});
