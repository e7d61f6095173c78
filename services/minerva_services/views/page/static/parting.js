/** Where this run and the one beside it part: the first difference, its cause, and a mark on the slider. */

import { make, short } from "./elements.js";

const MOST_BEFORE = 5;
const SIDES = ["a", "b"];

/** A line of text with a short path: its last folder and file. */
const nearby = (line) => line.replace(/(?:\/[^\s/:]+)+(?=\/[^\s/:]+\/[^\s/:]+:\d+)/g, "…");

/**
 * Shows the answer of `minerva bisect`.
 *
 * `ask()` sends the question, and is false if it cannot; `jump(frame)` shows a frame, `mark(frame)`
 * marks it on the slider, and `select(agent)` selects an agent on the page.
 */
export class Parting {
  #parts;
  #actions;
  #answer = null;
  #beside = "";
  #isAsking = false;

  constructor(parts, actions) {
    this.#parts = parts;
    this.#actions = actions;
    parts.button.addEventListener("click", () => this.#open());
  }

  /** Takes the name of the record with which this run is compared; without one there is no button. */
  begin(beside) {
    this.#beside = beside;
    this.#parts.button.hidden = beside === "";
  }

  close() {
    this.#parts.panel.hidden = true;
  }

  /** Takes the answer. */
  take({ answer, problem }) {
    this.#isAsking = false;
    this.#answer = answer ?? { problem };
    this.#actions.mark(answer?.frame ?? null);
    this.#draw();
  }

  /** Gives up an open question, for a reason such as the end of the world. */
  fail(reason) {
    if (this.#isAsking) this.take({ problem: reason });
  }

  #open() {
    this.#actions.select("");
    this.#parts.panel.hidden = false;
    // The first difference of two runs remains, while equal ones may continue.
    if (!this.#isAsking && (this.#answer?.frame ?? null) === null) {
      [this.#answer, this.#isAsking] = [null, true];
      if (!this.#actions.ask()) this.fail("there is no link to the world");
    }
    this.#draw();
  }

  // --- drawing ---

  #draw() {
    const close = make("button", "close", "×");
    close.title = "Close";
    close.addEventListener("click", () => this.close());
    const head = make("div", "head", make("h2", "", "Where the runs part"), close);
    const sides = make("p", "faint", `A: this run, B: ${this.#beside}`);
    this.#parts.panel.replaceChildren(head, sides, ...this.#found());
  }

  #found() {
    const answer = this.#answer;
    if (answer === null) return [make("p", "faint", "comparing the records …")];
    if (answer.problem !== undefined) return [make("p", "faint", answer.problem)];
    const { frame, frames, before, ended, damage } = answer;
    const more = before.length > MOST_BEFORE ? [make("li", "", `and ${before.length - MOST_BEFORE} more`)] : [];
    const entries = [...before.slice(0, MOST_BEFORE).map((text) => make("li", "", text)), ...more];
    const start = entries.length > 0 ? [make("h3", "", "Before the first frame"), make("ul", "", ...entries)] : [];
    const damages = damage.map((text) => make("p", "faint", text));
    // A remark of runs that begin differently says how.
    if (frame !== null) return [...this.#difference(answer), ...this.#cause(answer), ...(answer.remark === "" ? start : []), ...damages];
    const equal = frames === 0 ? "There are no frames to compare." : `The runs are equal in all ${frames} frames that both records have.`;
    return [make("p", "", equal), ...(ended === "" ? [] : [make("p", "faint", ended)]), ...start, ...damages];
  }

  #difference({ frame, changes, more, events }) {
    const jump = make("button", "", `frame ${frame}`);
    jump.addEventListener("click", () => this.#actions.jump(frame));
    const alone = SIDES.flatMap((side) => events[side].map((event) => make("p", "", `event of ${side.toUpperCase()} alone: `, make("b", "", short(event, 90)))));
    const rows = changes.map(({ agent, attribute, a, b }) => {
      const name = make("th", "", this.#mention(agent), attribute === "" ? "" : ` ${attribute}`);
      return make("tr", "", name, ...[a, b].map((value) => make("td", "", short(value, 90))));
    });
    const head = make("tr", "", make("th", "faint", "after it"), make("th", "", "A"), make("th", "", "B"));
    const table = rows.length > 0 ? [make("table", "", head, ...rows)] : [];
    const rest = more > 0 ? [make("p", "faint", `and ${more} more differences`)] : [];
    return [make("p", "", jump, " is the first that differs"), ...alone, ...table, ...rest];
  }

  #cause({ cause, why, functions, remark }) {
    if (cause === "") return [];
    const shown = [make("h3", "", "Cause"), make("p", "", cause)];
    for (const side of SIDES) {
      const steps = why[side].map((line) => make(/^\s{5}/.test(line) ? "code" : "p", /^\s/.test(line) ? "step" : "", nearby(line.trim())));
      if (steps.length > 0) shown.push(make("h4", "", side.toUpperCase()), ...steps);
    }
    for (const each of functions) {
      shown.push(make("h3", "", `The code differs: ${each.function}`));
      for (const side of SIDES) shown.push(make("p", "", `${side.toUpperCase()}: `, make("code", "", nearby(each[side]) || "not there")));
    }
    return remark === "" ? shown : [...shown, make("p", "", remark)];
  }

  #mention(agent) {
    const id = agent.split("#")[1];
    if (id === undefined) return agent;
    const button = make("button", "mention", agent);
    button.addEventListener("click", () => this.#actions.select(id));
    return button;
  }
}
