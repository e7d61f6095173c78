/** A host: it evolves agents and makes their views. */

import { condition } from "./condition.js";
import { Invalid } from "./msgpack.js";
import { agentStream } from "./random.js";
import { childId, copyId, readEvent, readString, same, writeEvent, writeString } from "./scene.js";

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

const probabilityOf = (method) => method.probability ?? 1;
const copied = (value) => (Array.isArray(value) ? value.map(copied) : value);
const copiedValues = (values) => Object.fromEntries(Object.entries(values).map(([name, value]) => [name, copied(value)]));

/** An agent while it is called. */
class Agent {
  constructor({ symbol, id, values, scope }, kind) {
    Object.assign(this, { symbol, id, scope, kind, values: copiedValues(values) });
  }

  /** A newborn with an id that derives from this agent's; its kind needs an attribute `births`. */
  child(values = {}, kind = this.kind) {
    if (typeof this.values.births !== "bigint") throw new Invalid(`${this.symbol} needs births: ["int", 0n] for a child`);
    this.values.births += 1n;
    const defaults = Object.entries(kind.fields).flatMap(([name, [, value]]) => (value === undefined ? [] : [[name, value]]));
    const id = childId(this.id, this.values.births);
    return { symbol: kind.symbol, id, values: { ...Object.fromEntries(defaults), ...values }, scope: [] };
  }

  get node() {
    return { symbol: this.symbol, id: this.id, values: this.values, scope: this.scope };
  }
}

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
    return { service: this.service, kinds: [...this.kinds.values()].map(plainKind) };
  }

  welcome({ policy }) {
    for (const known of [this.fragments, this.shown, this.evolved]) known.clear();
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
    const [read, shows] = [events, visual].map((list) => list.map((plain) => readEvent(plain, vocabulary)));
    const names = only.length > 0 ? only : [...this.fragments.keys()];
    const missing = names.find((name) => !this.fragments.has(name));
    if (missing !== undefined) throw new Invalid(`the fragment ${missing} was not given`);
    if (this.#isRepeated(frame, part)) return;
    this.member.own(() => this.#evolve(frame, part, names, read, shows));
  }

  #evolve(frame, part, names, events, shows) {
    const { vocabulary } = this.member;
    const views = this.#views(names, shows);
    const evolution = new Evolution(this, frame, events);
    const changed = new Map();
    for (const name of names) {
      const before = this.fragments.get(name);
      const after = evolution.of(before);
      if (!same(before, after, vocabulary)) changed.set(name, writeString(after, vocabulary));
      this.#keep(name, after);
    }
    this.member.send("evolved", frame, part, changed, evolution.emitted, views);
  }

  #isRepeated(frame, part) {
    if (frame !== this.frame) this.evolved.clear();
    this.frame = frame;
    return this.evolved.has(part) || !this.evolved.add(part);
  }

  /** A part of a population is kept whatever its agents have become. */
  #keep(name, after) {
    if (name.startsWith("~") || (after.length === 1 && after[0].id === name)) this.fragments.set(name, after);
    else this.#discard(name);
  }

  #views(names, events) {
    const { vocabulary } = this.member;
    const views = new Map(events.map((event) => [event.type, new Map()]));
    for (const event of events) {
      for (const name of names) {
        const view = writeString(this.#view(this.fragments.get(name), event), vocabulary);
        const text = JSON.stringify(view, (_, value) => (typeof value === "bigint" ? `${value}n` : Object.is(value, -0) ? "-0" : value));
        const shown = this.shown.get(name) ?? new Map();
        this.shown.set(name, shown);
        if (shown.get(event.type) !== text) views.get(event.type).set(name, view);
        shown.set(event.type, text);
      }
    }
    return views;
  }

  #view(nodes, event) {
    return nodes.flatMap((node) => {
      const kind = this.kinds.get(node.symbol);
      return kind?.views[event.type]?.(new Agent(node, kind), event) ?? [];
    });
  }
}

/** The evolution of fragments in one part of a frame. */
class Evolution {
  constructor(host, frame, events) {
    const { kinds, isLiteral, member } = host;
    Object.assign(this, { kinds, isLiteral, member, frame, events });
    this.emitted = new Map();
    this.streams = new Map();
  }

  of(nodes) {
    return this.events.length > 0 || this.isLiteral ? nodes.flatMap((node) => this.#node(node)) : nodes;
  }

  #node(node) {
    if (node.scope === undefined) return [node];
    const inside = { ...node, scope: this.of(node.scope) };
    if (node.id === undefined) return [inside];
    return this.isLiteral ? this.#copies(inside) : this.#live(inside, this.events, node.id);
  }

  /** One copy for each event, each evolved by its event. */
  #copies(node) {
    return this.events.flatMap((event, n) => {
      const copy = n === 0 ? node : this.#copy(node, n + 1, 1, height(node));
      return this.#live(copy, [event], node.id);
    });
  }

  #copy(node, number, ownHeight, innerHeight) {
    const scope = node.scope?.map((inner) => this.#copy(inner, number, innerHeight, innerHeight));
    const result = scope === undefined ? { ...node } : { ...node, scope };
    if (node.id === undefined) return result;
    return { ...result, id: copyId(node.id, this.frame, number, ownHeight) };
  }

  /** An agent after events; `receiver` is the id under which it gets them. */
  #live(node, events, receiver) {
    let [before, current, after] = [[], node, []];
    for (const event of events) {
      const method = this.kinds.get(current.symbol)?.on[event.type];
      if (method === undefined || !this.#concerns(event, method, current, receiver)) continue;
      const nodes = this.#call(method, event, current, receiver);
      const place = nodes.findIndex((each) => each.id === node.id);
      if (place < 0) return [...before, ...nodes, ...after];
      current = nodes[place];
      before = [...before, ...nodes.slice(0, place)];
      after = [...nodes.slice(place + 1), ...after];
    }
    return [...before, current, ...after];
  }

  #concerns(event, method, node, receiver) {
    if (event.receivers.length > 0 && !event.receivers.includes(receiver)) return false;
    if (!condition(event.condition)(node.values)) return false;
    const probability = probabilityOf(method);
    if (probability === 1) return true;
    const limit = typeof probability === "string" ? Number(node.values[probability]) : probability;
    return this.#stream(node.id, event.type).next() < limit;
  }

  #call(method, event, node, receiver) {
    const self = new Agent(node, this.kinds.get(node.symbol));
    const result = (method.act ?? method)(self, event, this.#moment(node, receiver));
    if (result === undefined) return [self.node];
    return [result].flat().map((each) => (each instanceof Agent ? each.node : each));
  }

  #moment(node, receiver) {
    return {
      frame: this.frame,
      dt: this.member.dt,
      random: () => this.#stream(node.id).next(),
      emit: (event) => {
        const written = writeEvent({ ...event, sender: node.id }, this.member.vocabulary);
        this.emitted.set(receiver, [...(this.emitted.get(receiver) ?? []), written]);
      },
    };
  }

  #stream(id, ...eventType) {
    const key = [id, ...eventType].join(" ");
    if (!this.streams.has(key)) this.streams.set(key, agentStream(this.member.seed, this.frame, id, ...eventType));
    return this.streams.get(key);
  }
}

/** The number of agents that stand around one another in a node, itself included. */
function height({ id, scope = [] }) {
  return (id === undefined ? 0 : 1) + Math.max(0, ...scope.map(height));
}
