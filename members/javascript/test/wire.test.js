/** Zenoh's messages as bytes: the examples of zenoh-wire.md, and what a reader must understand. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";

import { encode } from "../src/msgpack.js";
import * as wire from "../src/wire.js";

const DOCUMENT = readFileSync(new URL("../../../docs/reference/protocol/zenoh-wire.md", import.meta.url), "utf8");
const SIZE = 0xffff;
const hex = (data) => Buffer.from(data).toString("hex");
const bytes = (digits) => Uint8Array.from(Buffer.from(digits.replaceAll(" ", ""), "hex"));
const ascii = (text) => Uint8Array.from(Buffer.from(text));

function documented(title) {
  const [, body] = new RegExp(`^\`\`\`hex zenoh\n# ${title}\n(.*?)^\`\`\`$`, "ms").exec(DOCUMENT);
  return body.split("\n").map((line) => line.trim().split(/\s{2,}/)[0].replaceAll(" ", "")).join("");
}

const framed = (message, sequence) => wire.batches(message, sequence, SIZE)[0];

const EXAMPLES = {
  init: wire.init([1, 2, 3, 4], SIZE),
  open: wire.open(3, 0, [0xaa, 0xbb]),
  "keep alive": wire.keepAlive(),
  subscriber: framed(wire.declareSubscriber(1, "minerva/w/all"), 0),
  interest: framed(wire.interestInTokens(2, "minerva/w/alive/coordinator", true), 1),
  token: framed(wire.declareToken(3, "minerva/w/alive/rain"), 2),
  put: framed(wire.put("minerva/w/from/rain", encode(0n, ["leaving"])), 3),
  "undeclared token": framed(wire.undeclareToken(3), 4),
  close: wire.close(),
};

for (const [title, written] of Object.entries(EXAMPLES)) {
  test(`zenoh-wire.md: ${title}`, () => assert.equal(hex(written), documented(title)));
}

test("numbers above 2^31 are written in LEB128", () => {
  assert.deepEqual(wire.zint(0x7f), [0x7f]);
  assert.deepEqual(wire.zint(300), [0xac, 0x02]);
  assert.deepEqual(wire.zint(2 ** 35), [0x80, 0x80, 0x80, 0x80, 0x80, 0x01]);
});

test("sequence numbers begin again at 0", () => {
  assert.equal(wire.after(0x0fffffff, 1), 0);
  const [first, second] = wire.batches(new Uint8Array(100), 0x0fffffff, 66);
  assert.equal(hex(first.subarray(0, 5)), "66ffffff7f");
  assert.equal(hex(second.subarray(0, 2)), "2600");
});

test("fragments together are the message", () => {
  const message = Uint8Array.from({ length: 1000 }, (_, n) => n % 251);
  const batches = wire.batches(message, 5, 300);
  assert.ok(batches.every((batch) => batch.length <= 300));
  const read = batches.map(wire.readBatch);
  assert.deepEqual(read.map(({ more }) => more), [true, true, true, false]);
  assert.deepEqual(Buffer.concat(read.map(({ body }) => body)), Buffer.from(message));
});

test("a PUT with timestamp, encoding, schema and extensions", () => {
  const key = [0xfd, 0x05, 0x02, ...ascii("/a")]; // the sender's mapping 5, and a text
  const quality = [0x31, 0x0d];
  const body = [0xe1, 0x81, 0x02, 0x02, 0x01, 0x02, 0x09, 0x01, 0x78, 0x42, 0x01, 0x00, 0x03, ...ascii("abc")];
  const [message] = wire.readMessages(Uint8Array.from([...key, ...quality, ...body]));
  assert.deepEqual(message.key, { mapping: 5, suffix: "/a" });
  assert.equal(message.type, "put");
  assert.equal(hex(message.payload), hex(ascii("abc")));
});

test("transport messages after those of a FRAME are of the batch", () => {
  const body = Uint8Array.from([...wire.put("a", ascii("b")), ...wire.keepAlive(), ...wire.close()]);
  const [put, { type, body: rest }, ...none] = wire.readMessages(body);
  assert.deepEqual([put.type, type, none.length], ["put", "batch", 0]);
  const batch = wire.readBatch(rest);
  assert.deepEqual([batch.type, wire.readBatch(batch.body).type], ["keepAlive", "close"]);
});

test("declarations of an interest, and its end", () => {
  const token = [0x3e, 0x02, 0x66, 0x07, 0x00, 0x01, 0x61];
  const gone = [0x1e, 0x87, 0x07, 0x5f, 0x03, 0x01, 0x00, 0x61];
  const end = [0x3e, 0x02, 0x1a];
  const messages = [...wire.readMessages(Uint8Array.from([...token, ...gone, ...end]))];
  assert.deepEqual(messages.map(({ type }) => type), ["token", "noToken", "final"]);
  assert.deepEqual(messages[0], { type: "token", interest: 2, number: 7, key: { mapping: 0, suffix: "a" } });
  assert.deepEqual(messages[1].key, { mapping: 0, suffix: "a" });
  assert.equal(messages[2].interest, 2);
});

test("what is cut off or unknown is an error, never an endless loop", () => {
  const whole = wire.put("a", ascii("payload"));
  for (let size = 1; size < whole.length; size++) {
    assert.throws(() => [...wire.readMessages(whole.subarray(0, size))], wire.WireError);
  }
  assert.throws(() => wire.readBatch(bytes("1f")), wire.WireError);
  assert.throws(() => [...wire.readMessages(bytes("1c00"))], wire.WireError);
});
