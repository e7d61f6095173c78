/** The vectors in protocol/vectors that concern this package. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";

import { condition } from "../src/condition.js";
import { decode, encode, Extension, Invalid } from "../src/msgpack.js";
import { agentStream, hashOf, Philox } from "../src/random.js";
import { copyId, readEvent, readString, Vocabulary, writeEvent, writeString } from "../src/scene.js";

const FOLDER = new URL("../../../protocol/vectors/", import.meta.url);
const load = (name) => JSON.parse(readFileSync(new URL(`${name}.json`, FOLDER), "utf8"));
const bytes = (digits) => Uint8Array.from(Buffer.from(digits, "hex"));
const hex = (data) => Buffer.from(data).toString("hex");
const bits = (number) => hex(encode(number)).slice(2);
const real = (digits) => decode(bytes(`cb${digits}`));

/** Plain data from the notation of section 18 of PROTOCOL.md. */
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
});

each("integers", (input, expected) => {
  assert.equal(hex(encode(BigInt(input))), expected.msgpack);
  assert.equal(decode(bytes(expected.msgpack)), BigInt(input));
  assert.equal(decode(bytes(expected.accepted)), BigInt(input));
});

each("texts", (input, expected) => {
  const text = String.fromCodePoint(...input);
  assert.equal(hex(encode(text)), expected.msgpack);
  assert.equal(decode(bytes(expected.msgpack)), text);
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

each("strings", (_, expected, document) => {
  const vocabulary = new Vocabulary(untagged(document.vocabulary));
  const nodes = readString(decode(bytes(expected.msgpack)), vocabulary);
  assert.equal(hex(encode(writeString(nodes, vocabulary))), expected.msgpack);
});

each("values", (_, expected) => {
  assert.equal(hex(encode(decode(bytes(expected.msgpack)))), expected.msgpack);
});

each("events", (input, expected, document) => {
  const vocabulary = new Vocabulary(untagged(document.vocabulary));
  const plain = decode(bytes(input));
  if (plain.length === 6) return assert.throws(() => readEvent(plain, vocabulary), Invalid);
  if (expected === "refused") return assert.throws(() => readEvent(plain, vocabulary), Invalid);
  const event = readEvent(plain, vocabulary);
  assert.equal(hex(encode([writeEvent(event, vocabulary)])), expected.msgpack);
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
