/** The evolution of agents by the events of a frame. */

import { condition } from "./condition.js";
import { Invalid } from "./msgpack.js";
import { agentStream } from "./random.js";
import { childId, copyId, writeEvent } from "./scene.js";

/** The probability with which a method's agent responds to an event. */
export const probabilityOf = (method) => method.probability ?? 1;
const copied = (value) => (Array.isArray(value) ? value.map(copied) : value);
const copiedValues = (values) => Object.fromEntries(Object.entries(values).map(([name, value]) => [name, copied(value)]));

/** An agent while it is called. */
export class Agent {
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

/** Events by the agents that they are for, so that an agent does not look at those for others. */
class Addressed {
  constructor(events) {
    this.places = new Map(events.map((event, place) => [event, place]));
    this.toAll = events.filter(({ receivers }) => receivers.length === 0);
    this.byId = new Map();
    for (const event of events) for (const id of new Set(event.receivers)) this.#add(id, event);
  }

  #add(id, event) {
    if (this.byId.has(id)) this.byId.get(id).push(event);
    else this.byId.set(id, [event]);
  }

  /** The events for an agent, in their order. */
  to(id) {
    const own = this.byId.get(id);
    if (own === undefined) return this.toAll;
    return [...this.toAll, ...own].sort((a, b) => this.places.get(a) - this.places.get(b));
  }
}

/** The evolution of fragments in one part of a frame. */
export class Evolution {
  constructor(host, frame, events) {
    const { kinds, isLiteral, member } = host;
    Object.assign(this, { kinds, isLiteral, member, frame, events });
    this.addressed = new Addressed(events);
    this.emitted = new Map();
    this.streams = new Map();
  }

  /** Nodes after the events; the same list if none of them has been called. */
  of(nodes) {
    if (this.events.length === 0 && !this.isLiteral) return nodes;
    const after = nodes.flatMap((node) => this.#node(node));
    return after.length === nodes.length && after.every((node, n) => node === nodes[n]) ? nodes : after;
  }

  #node(node) {
    if (node.scope === undefined) return [node];
    const scope = this.of(node.scope);
    const inside = scope === node.scope ? node : { ...node, scope };
    if (node.id === undefined) return [inside];
    return this.isLiteral ? this.#copies(inside, height(node)) : this.#live(inside, this.addressed.to(node.id), node.id);
  }

  /** One copy for each event, each evolved by its event; `innerHeight` is that of before the frame. */
  #copies(node, innerHeight) {
    return this.events.flatMap((event, n) => {
      const copy = n === 0 ? node : this.#copy(node, n + 1, 1, innerHeight);
      const isFor = event.receivers.length === 0 || event.receivers.includes(node.id);
      return this.#live(copy, isFor ? [event] : [], node.id);
    });
  }

  #copy(node, number, ownHeight, innerHeight) {
    const scope = node.scope?.map((inner) => this.#copy(inner, number, innerHeight, innerHeight));
    const result = scope === undefined ? { ...node } : { ...node, scope };
    if (node.id === undefined) return result;
    return { ...result, id: copyId(node.id, this.frame, number, ownHeight) };
  }

  /** An agent after events that are for it; `receiver` is the id under which it gets them. */
  #live(node, events, receiver) {
    let [before, current, after] = [[], node, []];
    for (const event of events) {
      const method = this.kinds.get(current.symbol)?.on[event.type];
      if (method === undefined || !this.#concerns(event, method, current)) continue;
      const nodes = this.#call(method, event, current, receiver);
      const place = nodes.findIndex((each) => each.id === node.id);
      if (place < 0) return [...before, ...nodes, ...after];
      current = nodes[place];
      before = [...before, ...nodes.slice(0, place)];
      after = [...nodes.slice(place + 1), ...after];
    }
    return [...before, current, ...after];
  }

  #concerns(event, method, node) {
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
