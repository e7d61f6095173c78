/** A device: it draws the views of visual events. */

import { applyPatch, isPatch } from "./patches.js";
import { readSkeleton, readString } from "./scene.js";

/**
 * A device that `run` can start.
 *
 * `draw({type, frame, nodes, halted, vocabulary})` draws a view; `nodes` is the whole string, in which
 * outermost nodes have the id of their `agent`, or "~" in a population. A `coupled` device
 * draws every frame, any other one may miss some. `when`, such as "each 10 frames" or "at 25 Hz": the
 * device requests its views itself. `report()` returns figures for the summary.
 */
export function device({ service = "device", draws, draw, when = "", coupled = false, report = () => ({}) }) {
  return (member) => new Device(member, { service, draws, draw, when, coupled, report });
}

class Device {
  constructor(member, spec) {
    this.member = member;
    this.spec = spec;
    this.service = spec.service;
    this.subscriptions = spec.coupled ? ["tick"] : spec.draws.map((type) => `view/${type}`);
    this.publishes = [];
    this.views = new Map(spec.draws.map((type) => [type, new View()]));
  }

  hello() {
    const { draws, when, coupled } = this.spec;
    return { draws, when, coupled };
  }

  welcome() {
    for (const view of this.views.values()) view.sequence = -1n;
  }

  report() {
    return this.spec.report();
  }

  onTick(frame) {
    this.member.send("ticked", frame, [], null);
  }

  onView(type, frame, sequence, parts, skeleton, halted) {
    const view = this.views.get(type);
    if (view === undefined) return;
    const read = (string) => readString(string, this.member.vocabulary);
    const newSkeleton = skeleton === null ? null : readSkeleton(skeleton, this.member.vocabulary);
    if (view.misses(sequence, newSkeleton)) return this.member.send("resync", type);
    if (view.isOld(sequence, newSkeleton)) return;
    const known = newSkeleton === null ? view.parts : new Map();
    const part = (id, plain) => (isPatch(plain) ? applyPatch(known.get(id), plain, this.member.vocabulary) : read(plain));
    view.accept(sequence, new Map([...parts].map(([id, plain]) => [id, owned(id, part(id, plain))])), newSkeleton);
    this.member.own(() => this.spec.draw({ type, frame, nodes: view.nodes(), halted, vocabulary: this.member.vocabulary }));
  }
}

/** The nodes of a part with the id of their agent; a part of a population has a name that is no id. */
function owned(id, nodes) {
  const agent = id.startsWith("~") ? "~" : id;
  return nodes.map((node) => ({ ...node, agent }));
}

/** What is known of the views of one type. */
class View {
  sequence = -1n;
  skeleton = null;
  parts = new Map();

  misses(sequence, skeleton) {
    return skeleton === null && (this.skeleton === null || sequence > this.sequence + 1n);
  }

  isOld(sequence, skeleton) {
    return skeleton === null ? sequence !== this.sequence + 1n : sequence < this.sequence;
  }

  accept(sequence, parts, skeleton) {
    this.sequence = sequence;
    if (skeleton !== null) [this.skeleton, this.parts] = [skeleton, new Map()];
    for (const [id, part] of parts) this.parts.set(id, part);
  }

  nodes() {
    return this.#filled(this.skeleton);
  }

  #filled(nodes) {
    return nodes.flatMap((node) => {
      if (node.values === null) return this.parts.get(node.id) ?? [];
      return node.scope === undefined ? [node] : [{ ...node, scope: this.#filled(node.scope) }];
    });
  }
}
