/**
 * The protocol of a member as a state machine, without sockets and clocks.
 *
 * Messages come in by `onMessage` and `onCoordinator`; what the member does goes to its `outside`:
 * `put(key, bytes)`, `release()` and `rejoin()` of its token, `wait(seconds)` until it ends for
 * silence (null: for ever), `log(line)` and `end(exitCode)`.
 */

import { decode, decodeAll, encode, Invalid } from "./msgpack.js";
import { Vocabulary } from "./vocabulary.js";

export const VERSION = 7n;
/** Exit code after an error that the same input would cause again. */
const RAISED = 70;
const HERE = import.meta.url.replace(/[^/]*$/, "");
/** Where the messages that ask a member for work name their frame. */
const FRAME_AT = { tick: 0, evolve: 0, view: 1 };
const SECONDS = { greeting: 10, successor: 5, flushing: 1 };
/** Messages that begin a member's obedience to a coordinator. */
const LEADING = ["greet", "refused", "stop"];

const isFrame = (value) => typeof value === "bigint" && value >= 0n;
const isInt = (value) => typeof value === "bigint";
const isText = (value) => typeof value === "string";
const isMap = (value) => value instanceof Map;
const isList = Array.isArray;
const isTexts = (value) => isList(value) && value.every(isText);
const isNumber = (value) => typeof value === "bigint" || (typeof value === "number" && Number.isFinite(value));
const orNil = (check) => (value) => value === null || check(value);

const ITEMS = {
  greet: [],
  welcome: [isText, isMap, isInt, isNumber, isFrame, isText, orNil(isMap)],
  refused: [isText],
  sources: [(value) => isMap(value) && [...value.values()].every(isTexts)],
  tick: [isFrame],
  fragments: [isMap, isTexts],
  evolve: [isFrame, isTexts, isList, isList, isFrame, isTexts],
  view: [isText, isFrame, isFrame, isMap, orNil(isList), isTexts],
  orders: [isFrame, isList],
  repeat: [isText],
  stop: [isText],
};

export class Member {
  epoch = -1n;
  joined = null;
  /** The frame that it was last asked for; -1 before the first. */
  frame = -1n;
  #obeys = false;
  #isThere = false;
  #isStopping = false;

  constructor(name, makeRole, outside) {
    this.name = name;
    this.outside = outside;
    this.role = makeRole(this);
  }

  /** The keys of its subscriptions, after `minerva/<world>/`. */
  get subscriptions() {
    return ["all", `to/${this.name}`, ...this.role.subscriptions];
  }

  hello() {
    return {
      version: VERSION, kinds: [], generates: [], when: "", orders: [], draws: [], coupled: false, topics: [],
      publishes: [], about: { service: this.role.service, pid: this.outside.pid, host: this.outside.host },
      ...this.role.hello(),
    };
  }

  /** Whether a coordinator has welcomed it and is still there. */
  get takesPart() {
    return this.#obeys && this.joined !== null;
  }

  begin() {
    this.outside.wait(SECONDS.greeting);
  }

  send(...message) {
    this.outside.put(`from/${this.name}`, encode(this.epoch, message));
  }

  publish(topic, message) {
    this.outside.put(`topic/${topic}/${this.name}`, encode(message));
  }

  /** A message on a key, after `minerva/<world>/`. One that cannot be read is dropped. */
  onMessage(key, bytes) {
    try {
      if (key.startsWith("topic/")) this.#onTopic(key.split("/"), bytes);
      else this.#onCoordinatorMessage(bytes);
    } catch (error) {
      if (!(error instanceof Invalid)) return this.#fail(error);
      this.outside.log(`dropped a message on ${key}: ${error.message}`);
    }
  }

  /** Calls the program's own methods, whose invalid values are its failure, not that of a message. */
  own(call) {
    try {
      return call();
    } catch (error) {
      throw error instanceof Invalid ? new Error(error.message, { cause: error }) : error;
    }
  }

  #fail(error) {
    const problem = `${error.message ?? error}${ownPlace(String(error.stack ?? ""))}`;
    // The stack is in the log of the world.
    this.send("failed", this.frame, problem, String(error.stack ?? ""));
    this.outside.log(problem);
    this.outside.end(RAISED);
  }

  /** The coordinator's token has appeared or vanished. */
  onCoordinator(isThere) {
    if (this.#isStopping) return isThere || this.outside.end(0);
    if (!isThere && this.#isThere) this.#lose();
    else if (isThere && !this.#isThere && this.outside.isReleased()) this.outside.rejoin();
    this.#isThere = isThere;
  }

  /** It has its token again. */
  rejoined() {
    this.outside.wait(SECONDS.greeting);
  }

  #lose() {
    this.outside.release();
    // The same coordinator may come back with the same epoch, but must greet first.
    this.epoch -= 1n;
    this.#obeys = false;
    this.outside.wait(SECONDS.successor);
  }

  #onTopic([, topic, publisher], bytes) {
    if (this.joined === null) return;
    const message = decode(bytes);
    if (!isList(message) || message.length !== 3) throw new Invalid("not readings");
    const [name, frame, readings] = message;
    if (name !== "readings" || !isInt(frame) || frame < -1n || !isList(readings)) throw new Invalid("not readings");
    this.role.onReadings(topic, publisher, frame, readings);
  }

  #onCoordinatorMessage(bytes) {
    const [epoch, message] = decodeAll(bytes, 2);
    if (!isInt(epoch) || !isList(message)) throw new Invalid("not a message");
    const [name, ...items] = message;
    const checks = isText(name) && Object.hasOwn(ITEMS, name) ? ITEMS[name] : null;
    if (checks === null) throw new Invalid(`no message is called ${String(name)}`);
    if (items.length !== checks.length || !checks.every((check, n) => check(items[n]))) {
      throw new Invalid(`the items of ${name}`);
    }
    if (this.#follows(epoch, name)) this.#act(name, items);
  }

  #follows(epoch, name) {
    if (epoch > this.epoch && LEADING.includes(name)) [this.epoch, this.#obeys] = [epoch, true];
    return this.#obeys && epoch === this.epoch;
  }

  #act(name, items) {
    if (name === "greet") this.send("hello", this.hello());
    else if (name === "welcome") this.#welcome(...items);
    else if (name === "refused") {
      this.outside.log(`refused: ${items[0]}`);
      this.outside.end(2);
    } else if (name === "stop") this.#stop();
    else if (this.joined !== null || name === "sources") {
      if (name in FRAME_AT) this.frame = items[FRAME_AT[name]];
      this.role[`on${name[0].toUpperCase()}${name.slice(1)}`]?.(...items);
    }
  }

  #welcome(_, vocabulary, seed, dt, frame, policy, saved) {
    const isAgain = this.joined !== null;
    if (isAgain && (seed !== this.seed || Number(dt) !== this.dt)) {
      this.outside.log("the world has another seed or step than before");
      return this.outside.end(1);
    }
    this.vocabulary = new Vocabulary(vocabulary);
    Object.assign(this, { seed, dt: Number(dt), joined: { frame, policy, saved } });
    this.outside.wait(null);
    this.role.welcome(this.joined, isAgain);
  }

  /** The report must arrive before the session ends, so it stays for a moment. */
  #stop() {
    this.send("report", this.own(() => this.role.report()));
    this.#isStopping = true;
    this.outside.wait(SECONDS.flushing, 0);
  }
}

/** The innermost line of a stack in the program's own code, as a second line of an error; "" without one. */
function ownPlace(stack) {
  const isOwn = (line) => /^\s+at .*:\d+:\d+\)?$/.test(line) && !line.includes(HERE) && !line.includes("node:");
  const line = stack.split("\n").find(isOwn);
  return line === undefined ? "" : `\n${line.trimEnd()}`;
}
