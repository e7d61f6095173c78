/** Runs a member over a Zenoh session until its world ends. */

import { Member } from "./member.js";
import { Session } from "./zenoh.js";

const SECONDS = { taken: 2, takenAgain: 4 };
const POLL = 50; // milliseconds
const MILLISECONDS = 1000;

const sleep = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

/** Where a process of a world file finds its world, as its launcher sets it. */
function environment() {
  const given = globalThis.process?.env ?? {};
  const { MINERVA_WORLD: world, MINERVA_CONNECT: endpoint, MINERVA_NAME: name } = given;
  return { world, endpoint, name };
}

/**
 * Takes part in a world until it ends, as a `generator`, `host` or `device`.
 *
 * World, endpoint and name come from the environment, as a launcher sets it, unless `options` has
 * them. Resolves to an exit code, which also becomes the one of the process. `options.signal`, an
 * AbortSignal, lets the member leave; in Node, SIGINT and SIGTERM do.
 */
export async function run(makeRole, options = {}) {
  const { world, endpoint, name, signal, log } = { log: console.error, ...environment(), ...options };
  for (const [option, value] of Object.entries({ MINERVA_WORLD: world, MINERVA_CONNECT: endpoint, MINERVA_NAME: name })) {
    if (!value) throw new Error(`${option} is not set; start this program by a world file, or set it`);
  }
  const process_ = new MemberProcess(makeRole, { world, name, log });
  const leave = () => process_.leave();
  signal?.addEventListener("abort", leave);
  for (const each of ["SIGINT", "SIGTERM"]) globalThis.process?.once?.(each, leave);
  const code = await process_.run(endpoint).catch((error) => {
    log(`${name}: ${error.message || error.code}: no world at ${endpoint}`);
    return 1;
  });
  if (globalThis.process) globalThis.process.exitCode = code;
  for (const each of ["SIGINT", "SIGTERM"]) globalThis.process?.removeListener?.(each, leave);
  return code;
}

class MemberProcess {
  pid = BigInt(globalThis.process?.pid ?? 0);
  host = "";
  #session;
  #undeclare = null;
  #timer;
  #ended;

  constructor(makeRole, { world, name, log }) {
    this.prefix = `minerva/${world}/`;
    this.coordinator = `${this.prefix}alive/coordinator`;
    this.alive = `${this.prefix}alive/${name}`;
    this.log = (line) => log(`${name}: ${line}`);
    this.code = new Promise((resolve) => (this.#ended = resolve));
    this.member = new Member(name, makeRole, this);
  }

  async run(endpoint) {
    this.#session = await Session.open(endpoint, {
      onSample: ({ key, payload }) => this.#isOver || this.member.onMessage(key.slice(this.prefix.length), payload),
      onToken: (key, isAlive) => this.#isOver || (key === this.coordinator && this.member.onCoordinator(isAlive)),
      onProblem: this.log,
    });
    if (await this.#takeName(SECONDS.taken)) {
      for (const key of this.member.subscriptions) this.#session.subscribe(this.prefix + key);
      this.#session.watch(this.coordinator);
      this.#declareToken();
      this.member.begin();
    }
    const code = await this.code;
    this.release();
    this.#session.close();
    this.member.role.close?.();
    return code;
  }

  leave() {
    if (this.member.joined !== null) this.member.send("leaving");
    this.end(0);
  }

  #isOver = false;

  async #takeName(seconds) {
    const until = performance.now() + seconds * MILLISECONDS;
    while ((await this.#session.tokens(this.alive)).length > 0) {
      if (this.#isOver) return false;
      if (performance.now() > until) {
        this.log("another member has this name");
        this.end(1);
        return false;
      }
      await sleep(POLL);
    }
    return !this.#isOver;
  }

  #declareToken() {
    this.#undeclare = this.#session.declareToken(this.alive);
  }

  // --- what the member does outside ---

  put(key, bytes) {
    this.#session.put(this.prefix + key, bytes);
  }

  isReleased() {
    return this.#undeclare === null;
  }

  release() {
    this.#undeclare?.();
    this.#undeclare = null;
  }

  async rejoin() {
    this.wait(null);
    if (!(await this.#takeName(SECONDS.takenAgain))) return;
    this.#declareToken();
    this.member.rejoined();
  }

  wait(seconds, code = 1) {
    clearTimeout(this.#timer);
    if (seconds === null) return;
    const end = () => {
      if (code !== 0) this.log(`no coordinator for ${seconds} s`);
      this.end(code);
    };
    this.#timer = setTimeout(end, seconds * MILLISECONDS);
  }

  end(code) {
    this.#isOver = true;
    clearTimeout(this.#timer);
    this.#ended(code);
  }
}
