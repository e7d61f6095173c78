/** A free-running generator: it sends events at any time, as a sensor does. */

import { writeEvents } from "./scene.js";

/**
 * A free-running generator that `run` can start; no frame waits for it.
 *
 * `start(emit, world)` is called once it has joined; it may return a function, which is called at
 * the end. `emit(...events)` sends events, which the next frame gets. A world has `dt`, in seconds,
 * and `name`, that of the member. `people` marks events of people, for norms. `report()` returns
 * figures for the summary.
 */
export function source({ service = "source", generates, start, people = false, report = () => ({}) }) {
  return (member) => new Source(member, { service, generates, start, people, report });
}

class Source {
  subscriptions = [];
  publishes = [];

  constructor(member, spec) {
    this.member = member;
    this.spec = spec;
    this.service = spec.service;
  }

  hello() {
    const { generates, people } = this.spec;
    return { generates, when: "freely", people };
  }

  welcome(_, isAgain) {
    if (isAgain) return;
    const { name, dt } = this.member;
    this.stop = this.member.own(() => this.spec.start((...events) => this.#emit(events), { name, dt }));
  }

  report() {
    return this.spec.report();
  }

  close() {
    this.stop?.();
  }

  /** Sends events; without a coordinator they are dropped, because nobody could receive them. */
  #emit(events) {
    const { member } = this;
    if (!member.takesPart || events.length === 0) return;
    member.send("emitted", member.own(() => writeEvents(events, member.vocabulary)));
  }
}
