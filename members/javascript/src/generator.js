/** A generator in step: it makes the events of each frame. */

import { Invalid } from "./msgpack.js";
import { Philox } from "./random.js";
import { readReading, writeReading } from "./readings.js";
import { readEvents, writeEvents } from "./scene.js";

/**
 * A generator that `run` can start.
 *
 * `tick(moment)` returns the events of a frame. A moment has `frame` (BigInt), `dt` (seconds),
 * `state`, `orders` (events of people), `readings`, `random()` and `publish(topic, ...readings)`.
 * `state` is an object of plain values, which the coordinator keeps for a successor: a whole number
 * in it is a BigInt. `report(state)` returns figures for the summary. An `ahead` generator depends
 * on the frame alone.
 */
export function generator({
  service = "generator", generates, tick, state = {}, orders = [], topics = [], publishes = [],
  report = () => ({}),
}) {
  return (member) => new Generator(member, { service, generates, tick, state, orders, topics, publishes, report });
}

class Generator {
  constructor(member, spec) {
    this.member = member;
    this.spec = spec;
    this.service = spec.service;
    this.subscriptions = ["tick", ...spec.topics.map((topic) => `topic/${topic}/*`)];
    this.publishes = spec.publishes;
    this.state = structuredClone(spec.state);
    this.asked = null;
    this.askedBy = null; // the epoch of the coordinator; its successor asks again
    this.answer = null;
    this.orders = [];
    this.sources = [];
    this.readings = new Map();
  }

  hello() {
    const { generates, orders, topics, publishes } = this.spec;
    return { generates, when: "in step", orders, topics, publishes };
  }

  welcome({ frame, saved }, isAgain) {
    this.asked = null;
    this.readings.clear();
    // The predecessor's answer to this frame may already count, so it is given again.
    if (isAgain && this.answer?.frame === frame) return;
    this.answer = null;
    if (saved !== null) this.state = plainObject(saved);
  }

  report() {
    return this.spec.report(this.state);
  }

  onSources(publishers) {
    const ofTopic = (topic) => (publishers.get(topic) ?? []).map((publisher) => `${topic}/${publisher}`);
    this.sources = this.spec.topics.flatMap(ofTopic);
    this.#tryToAnswer();
  }

  onOrders(frame, events) {
    const read = readEvents(events, this.member.vocabulary);
    this.orders = this.orders.filter((order) => order.frame !== frame);
    this.orders.push({ frame, events: read });
  }

  onReadings(topic, publisher, frame, readings) {
    this.readings.set(`${frame} ${topic}/${publisher}`, readings.map(readReading));
    this.#tryToAnswer();
  }

  onTick(frame) {
    if (this.answer?.frame === frame) return this.#give(this.answer);
    [this.asked, this.askedBy] = [frame, this.member.epoch];
    this.#tryToAnswer();
  }

  onRepeat(topic) {
    if (this.answer?.published.has(topic)) this.member.publish(topic, this.answer.published.get(topic));
  }

  #tryToAnswer() {
    if (this.asked === null || this.askedBy !== this.member.epoch) return;
    if (this.sources.some((source) => !this.readings.has(`${this.asked} ${source}`))) return;
    const frame = this.asked;
    this.asked = null;
    this.answer = this.member.own(() => this.#answer(frame));
    this.#give(this.answer);
  }

  #answer(frame) {
    const { member, spec, state } = this;
    const published = new Map(spec.publishes.map((topic) => [topic, []]));
    const publish = (topic, ...readings) => {
      if (!published.has(topic)) throw new Invalid(`${topic} is not among the topics that it publishes`);
      published.get(topic).push(...readings.map(writeReading));
    };
    let stream;
    const random = () => (stream ??= new Philox(member.seed, member.name, frame)).next();
    const moment = { frame, dt: member.dt, state, random, publish };
    Object.assign(moment, { orders: this.#takeOrders(frame), readings: this.#takeReadings(frame) });
    const events = writeEvents([...(spec.tick(moment) ?? [])], member.vocabulary);
    const saved = Object.keys(state).length > 0 ? structuredClone(state) : null;
    for (const [topic, readings] of published) published.set(topic, ["readings", frame, readings]);
    return { frame, published, ticked: ["ticked", frame, events, saved] };
  }

  #takeOrders(frame) {
    const due = this.orders.filter((order) => order.frame <= frame);
    this.orders = this.orders.filter((order) => order.frame > frame);
    return due.sort((a, b) => (a.frame < b.frame ? -1 : 1)).flatMap((order) => order.events);
  }

  #takeReadings(frame) {
    const keys = [...this.readings.keys()];
    const frameOf = (key) => BigInt(key.split(" ")[0]);
    const isDue = (key) => [frame, -1n].includes(frameOf(key));
    const source = (key) => key.split(" ")[1].split("/");
    const inOrder = keys.filter(isDue).sort((a, b) => compare(source(a), source(b)));
    const due = inOrder.flatMap((key) => this.readings.get(key));
    for (const key of keys) if (frameOf(key) <= frame) this.readings.delete(key);
    return due;
  }

  #give({ published, ticked }) {
    for (const [topic, readings] of published) this.member.publish(topic, readings);
    this.member.send(...ticked);
  }
}

const compareTexts = (a, b) => (a < b ? -1 : a > b ? 1 : 0);
const compare = (a, b) => compareTexts(a[0], b[0]) || compareTexts(a[1], b[1]);

function plainObject(value) {
  if (value instanceof Map) return Object.fromEntries([...value].map(([key, item]) => [key, plainObject(item)]));
  return Array.isArray(value) ? value.map(plainObject) : value;
}
