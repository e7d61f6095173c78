/** A free-running generator, against a coordinator of plain messages. */

import assert from "node:assert/strict";
import test from "node:test";

import { Member } from "../src/member.js";
import { decodeAll, encode } from "../src/msgpack.js";
import { event } from "../src/scene.js";
import { source } from "../src/source.js";

const VOCABULARY = {
  primitives: [], transformations: [], kinds: [], events: [["eTilt", [["x", "real", null]], false]],
};

/** A member with the messages that it has sent; `receive` gives it one of the coordinator. */
function started(spec, epoch = 5n) {
  const sent = [];
  const outside = {
    pid: 1n, host: "", put: (key, bytes) => sent.push(decodeAll(bytes, 2)[1]), wait() {}, release() {}, log() {},
    isReleased: () => false, end() {},
  };
  const member = new Member("tilt", source({ generates: ["eTilt"], ...spec }), outside);
  const receive = (...message) => member.onMessage("to/tilt", encode(epoch, message));
  return { member, sent, receive };
}

const welcome = ["welcome", "w", VOCABULARY, 7n, 0.1, 3n, "sequential", null];

test("it begins when it has joined, and sends events at any time", () => {
  let emit = null;
  let world = null;
  const { member, sent, receive } = started({ start: (given, about) => ([emit, world] = [given, about]), people: true });
  receive("greet");
  assert.equal(sent[0][0], "hello");
  const hello = sent[0][1];
  assert.deepEqual([hello.get("when"), hello.get("people"), hello.get("generates")], ["freely", true, ["eTilt"]]);
  assert.equal(emit, null);
  receive(...welcome);
  assert.deepEqual(world, { name: "tilt", dt: 0.1 });
  emit(event("eTilt", { x: 1 }), event("eTilt", { x: -0.5 }));
  assert.deepEqual(sent[1], ["emitted", [["eTilt", [1]], ["eTilt", [-0.5]]]]);
  emit();
  assert.equal(sent.length, 2);
  assert.throws(() => emit(event("eTilt", { x: "far" })), /x of eTilt/);
  assert.equal(sent.length, 2);
  member.onCoordinator(true);
});

test("it begins once, sends nothing without a coordinator, and is stopped at the end", () => {
  let [emit, stopped, count] = [null, 0, 0];
  const start = (given) => {
    [emit, count] = [given, count + 1];
    return () => (stopped += 1);
  };
  const { member, sent, receive } = started({ start });
  receive("greet");
  receive(...welcome);
  member.onCoordinator(true);
  member.onCoordinator(false);
  emit(event("eTilt", { x: 1 }));
  assert.deepEqual(sent.map(([name]) => name), ["hello"]);
  receive("greet");
  receive(...welcome);
  emit(event("eTilt", { x: 1 }));
  assert.deepEqual(sent.map(([name]) => name), ["hello", "hello", "emitted"]);
  member.role.close();
  assert.deepEqual([count, stopped], [1, 1]);
});
