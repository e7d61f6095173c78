/** A host: it evolves agents and makes their views. */

import { commonShape, MANY } from "./columns.js";
import { Agent, Evolution, probabilityOf } from "./evolution.js";
import { Invalid } from "./msgpack.js";
import { difference, isEmpty } from "./patches.js";
import { readEvents, readString, same, writeString } from "./scene.js";

/**
 * A kind of agents.
 *
 * `fields` maps attributes to type and default, such as `{water: ["real", 3], births: ["int", 0n]}`.
 * `on` maps event types to methods `(self, event, moment)`, or to `{probability, act}`. A method
 * changes `self.values`. If it returns nodes, they replace the agent: `[]` is its death, and
 * `[self, self.child({water: 1})]` a birth. A moment has `frame`, `dt`, `random()` and
 * `emit(event)`. `views` maps visual event types to functions `(self, event)` that return figures.
 */
export function agent(symbol, { fields, on = {}, views = {} }) {
  return { symbol, fields, on, views };
}

/** A host of kinds that `run` can start. */
export function host(kinds, { service = "host", report = () => ({}) } = {}) {
  return (member) => new Host(member, new Map(kinds.map((kind) => [kind.symbol, kind])), service, report);
}

const DEFAULT_TEXTS = {
  string: (value) => JSON.stringify(value), number: String, bigint: String, boolean: String, undefined: () => null,
};

function plainKind({ symbol, fields, on, views }) {
  const attributes = Object.entries(fields).map(([name, [type, value]]) => [name, type, DEFAULT_TEXTS[typeof value](value)]);
  const subscribed = Object.entries(on).map(([type, method]) => (probabilityOf(method) === 1 ? type : [type, method.probability]));
  return [symbol, attributes, subscribed, Object.keys(views), []];
}

const POLICIES = ["sequential", "literal"];

/** Whether a fragment is part of a population. */
const isPart = (name) => name.startsWith("~");
const idsOf = (nodes) => nodes.map(({ id }) => id);

class Host {
  subscriptions = ["evolve"];
  publishes = [];
  fragments = new Map();
  shown = new Map();
  evolved = new Set();
  frame = -1n;

  constructor(member, kinds, service, report) {
    Object.assign(this, { member, kinds, service, report });
  }

  hello() {
    return { kinds: [...this.kinds.values()].map(plainKind) };
  }

  welcome({ policy }) {
    for (const known of [this.fragments, this.shown, this.evolved]) known.clear();
    if (!POLICIES.includes(policy)) {
      throw new Error(`the world has policy = "${policy}", but this host knows ${POLICIES.join(" and ")} only`);
    }
    this.isLiteral = policy === "literal";
  }

  onFragments(given, dropped) {
    const read = [...given].map(([name, string]) => [name, readString(string, this.member.vocabulary)]);
    for (const name of dropped) this.#discard(name);
    for (const [name, nodes] of read) {
      this.#discard(name);
      this.fragments.set(name, nodes);
    }
  }

  #discard(name) {
    this.fragments.delete(name);
    this.shown.delete(name);
  }

  onEvolve(frame, asked, events, visual, part, only) {
    if (!asked.includes(this.member.name)) return;
    const { vocabulary } = this.member;
    const [read, shows] = [events, visual].map((list) => readEvents(list, vocabulary));
    const names = only.length > 0 ? only : [...this.fragments.keys()];
    const missing = names.find((name) => !this.fragments.has(name));
    if (missing !== undefined) throw new Invalid(`the fragment ${missing} was not given`);
    if (this.#isRepeated(frame, part)) return;
    this.member.own(() => this.#evolve(frame, part, names, read, shows));
  }

  #evolve(frame, part, names, events, shows) {
    const views = this.#views(names, shows);
    const evolution = new Evolution(this, frame, events);
    const changed = new Map();
    for (const name of names) {
      const before = this.fragments.get(name);
      const after = evolution.of(before);
      if (before === after) continue;
      const state = { nodes: after, keys: idsOf(after) };
      const plain = this.#change(name, { nodes: before, keys: idsOf(before) }, state);
      if (plain !== null) changed.set(name, plain);
      this.#keep(name, before, after);
    }
    this.member.send("evolved", frame, part, changed, evolution.emitted, views);
  }

  /** What to send of a fragment or view that was in another state before: a patch, a string, or null. */
  #change(name, before, after) {
    const { vocabulary } = this.member;
    if (!isPart(name)) return same(before.nodes, after.nodes, vocabulary) ? null : writeString(after.nodes, vocabulary);
    const patch = difference(before.nodes, after.nodes, vocabulary, before.keys, after.keys);
    if (patch !== null) return isEmpty(patch) ? null : patch;
    return same(before.nodes, after.nodes, vocabulary) ? null : this.#whole(name, after.nodes);
  }

  /** A fragment or view as a string; a part of a population is in columns however small it is. */
  #whole(name, nodes) {
    return writeString(nodes, this.member.vocabulary, isPart(name) ? 1 : MANY);
  }

  #isRepeated(frame, part) {
    if (frame !== this.frame) this.evolved.clear();
    this.frame = frame;
    return this.evolved.has(part) || !this.evolved.add(part);
  }

  /** A part of a population is kept if its agents can still be columns of their kind. */
  #keep(name, before, after) {
    const isKept = isPart(name)
      ? after.length > 0 && commonShape(after, this.member.vocabulary) === before[0].symbol
      : after.length === 1 && after[0].id === name;
    if (isKept) this.fragments.set(name, after);
    else this.#discard(name);
  }

  #views(names, events) {
    const views = new Map(events.map((event) => [event.type, new Map()]));
    for (const event of events) {
      for (const name of names) {
        const view = this.#viewOf(this.fragments.get(name), event);
        const shown = this.shown.get(name) ?? new Map();
        this.shown.set(name, shown);
        const before = shown.get(event.type);
        const plain = before === undefined ? this.#whole(name, view.nodes) : this.#change(name, before, view);
        if (plain !== null) views.get(event.type).set(name, plain);
        shown.set(event.type, view);
      }
    }
    return views;
  }

  /** A view of a fragment; its keys are the ids of its agents if each has one node of it. */
  #viewOf(fragment, event) {
    const views = fragment.map((node) => this.#view([node], event));
    const nodes = views.flat();
    const keys = views.every((view) => view.length === 1) ? idsOf(fragment) : [...nodes.keys()];
    return { nodes, keys };
  }

  #view(nodes, event) {
    return nodes.flatMap((node) => {
      const kind = this.kinds.get(node.symbol);
      return kind?.views[event.type]?.(new Agent(node, kind), event) ?? [];
    });
  }
}
