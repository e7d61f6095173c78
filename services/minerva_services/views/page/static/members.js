/** The members that this page is: each takes part under a name of its own. */

import { run } from "minerva-bus";

import { socketUrl } from "./server.js";

const RETRY = 1000; // milliseconds
/** What an exit code of a member means; with any other it is tried again. */
const STATES = { 0: "done", 2: "refused" };

/**
 * A member that takes part in a world under a name, while `mayJoin()` is true.
 *
 * `poke()` joins if it does not take part; `state` is `waiting`, `here`, `refused` or `done`.
 */
export class PageMember {
  #makeRole;
  #world;
  #mayJoin;
  #log;
  #nextAttempt = 0;
  state = "waiting";

  constructor(name, makeRole, { world, mayJoin = () => true, log }) {
    this.name = name;
    this.#makeRole = makeRole;
    this.#world = world;
    this.#mayJoin = mayJoin;
    this.#log = log;
  }

  async poke() {
    if (this.state !== "waiting" || performance.now() < this.#nextAttempt || !this.#mayJoin()) return;
    this.state = "here";
    const endpoint = socketUrl(`/bus?name=${encodeURIComponent(this.name)}`);
    const code = await run(this.#makeRole, { world: this.#world, endpoint, name: this.name, log: this.#log });
    this.#nextAttempt = performance.now() + RETRY;
    this.state = STATES[code] ?? "waiting";
  }
}

/**
 * What a module exports under a name, in the object that is its default export.
 *
 * That is a role for `run`, or `{role, button, prepare}`: then it starts when a person presses the
 * button with this text, and `prepare()`, if there is one, is called first, for instance to ask for
 * permission.
 */
export async function loadMember(path, name) {
  const { default: members } = await import(path);
  const exported = members?.[name];
  const { role, button = "", prepare = async () => {} } = typeof exported === "function" ? { role: exported } : exported ?? {};
  if (typeof role !== "function") throw new Error(`the default export of ${path} has no ${name} such as host([...])`);
  return { role, button, prepare };
}
