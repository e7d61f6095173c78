/** The panel about one agent: its state, the cause of a value, what it received and what was rejected. */

import { make, short } from "./elements.js";

const EVERY = 1000; // milliseconds between two states of a live world

/**
 * Shows one agent.
 *
 * `ask(message)` sends `{state}` and `{explain, attribute, frame}`, and is false if it cannot;
 * `past()` is the frame of the past that the page shows, or null; `asked()` the frame that questions
 * are about, null for the latest one; `select(agent)` selects another agent on the page.
 */
export class Inspector {
  #panel;
  #ask;
  #past;
  #asked;
  #select;
  #frame = null; // of the last question
  #agent = "";
  #kind = "";
  #state = {};
  #about = null; // the answer about the agent, or {problem}
  #attribute = "";
  #cause = null; // the answer about the attribute, or {problem}
  #drawn = "";

  constructor(panel, { ask, past, asked, select }) {
    this.#panel = panel;
    this.#ask = ask;
    this.#past = past;
    this.#asked = asked;
    this.#select = select;
    setInterval(() => this.#poll(), EVERY);
  }

  /** Shows an agent, or with "" none. */
  open(agent) {
    if (agent === this.#agent) return;
    this.#agent = agent;
    [this.#kind, this.#state, this.#about, this.#attribute, this.#cause] = ["", {}, null, "", null];
    this.refresh();
  }

  /** Asks again, because another frame is shown. */
  refresh() {
    this.#panel.hidden = this.#agent === "";
    if (this.#agent === "") return;
    [this.#about, this.#cause] = [null, null];
    // Values of another frame would be wrong ones.
    if (this.#past() !== null) this.#state = {};
    this.#poll();
    this.#question(this.#past() === null ? this.#attribute : "");
    this.#draw();
  }

  /** Takes the state of an agent of a live world. */
  take({ agent, kind, state }) {
    if (agent !== this.#agent || this.#past() !== null) return;
    [this.#kind, this.#state] = [kind, state];
    this.#draw();
  }

  /** Takes an answer about an agent or an attribute. */
  explain({ agent, attribute, frame, answer, problem }) {
    if (agent !== this.#agent || frame !== this.#frame || !["", this.#attribute].includes(attribute)) return;
    const taken = answer ?? { problem };
    if (attribute === "") this.#about = taken;
    else this.#cause = taken;
    if (attribute === "" && answer !== undefined && this.#past() !== null) [this.#kind, this.#state] = [answer.kind, answer.state];
    this.#draw();
    // One after the other: the server answers the last question of a page only.
    if (this.#about === null) this.#question("");
    else if (this.#attribute !== "" && this.#cause === null) this.#question(this.#attribute);
  }

  /** Gives up the open questions, for a reason such as the end of the world. */
  fail(reason) {
    if (this.#agent === "") return;
    this.#about ??= { problem: reason };
    if (this.#attribute !== "") this.#cause ??= { problem: reason };
    this.#draw();
  }

  #poll() {
    if (this.#agent !== "" && this.#past() === null) this.#ask({ state: this.#agent });
  }

  #question(attribute) {
    this.#frame = this.#asked();
    const isSent = this.#ask({ explain: this.#agent, attribute, frame: this.#frame });
    if (!isSent) this.fail("there is no link to the world");
  }

  #choose(attribute) {
    this.#attribute = attribute === this.#attribute ? "" : attribute;
    this.#cause = null;
    if (this.#attribute !== "" || this.#about === null) this.#question(this.#attribute);
    this.#draw();
  }

  // --- drawing ---

  #draw() {
    const frame = this.#past();
    const drawn = JSON.stringify([this.#agent, this.#kind, this.#state, this.#about, this.#attribute, this.#cause, frame]);
    // A new element under a finger would lose its tap.
    if (drawn === this.#drawn) return;
    this.#drawn = drawn;
    const close = make("button", "close", "×");
    close.title = "Close";
    close.addEventListener("click", () => this.#select(""));
    const title = make("h2", "", `${this.#kind}#${this.#agent}`);
    const when = make("p", "faint", frame === null ? "now" : `at the beginning of frame ${frame}`);
    const top = this.#panel.scrollTop;
    this.#panel.replaceChildren(make("div", "head", title, close), when, this.#table(), ...this.#received());
    this.#panel.scrollTop = top;
  }

  #table() {
    const rows = Object.entries(this.#state).flatMap(([name, value]) => {
      const button = make("button", "attribute", name);
      button.title = `Why is ${name} ${short(value)}?`;
      button.setAttribute("aria-expanded", String(name === this.#attribute));
      button.addEventListener("click", () => this.#choose(name));
      const cell = make("td", "", short(value));
      cell.title = short(value, 400);
      const row = make("tr", "", make("th", "", button), cell);
      if (name !== this.#attribute) return [row];
      const cause = make("td", "cause", ...this.#explanation());
      cause.colSpan = 2;
      return [row, make("tr", "", cause)];
    });
    return make("table", "", ...rows);
  }

  #explanation() {
    const cause = this.#cause;
    if (cause === null) return [make("p", "faint", "looking for the cause …")];
    if (cause.problem !== undefined) return [make("p", "faint", cause.problem)];
    const since = cause.since >= 0 ? `since frame ${cause.since}` : "since the initial string";
    const head = make("p", "", `${short(cause.value)} at the beginning of frame ${cause.frame}, ${since}`);
    const links = cause.links.map((link) => make("li", "", ...this.#link(link)));
    return [head, make("ol", "", ...links), make("p", "", make("b", "", "origin: "), cause.origin), ...rejections(cause.rejected)];
  }

  #link({ frame, agent, did, method, place, event, source, remark }) {
    const parts = [make("p", "", `frame ${frame}: `, this.#mention(agent), ` ${did}`)];
    if (method !== "") parts.push(make("p", "faint", place === null ? method : `${method}, ${place.file.split("/").at(-1)}:${place.line}`));
    if (place !== null && place.shown?.length > 0) parts.push(make("code", "", place.shown[0].trim()));
    if (event !== "") {
      const from = source === null ? [] : [", from ", ...this.#source(source)];
      parts.push(make("p", "", "because it received ", make("b", "", short(event, 90)), ...from));
    }
    if (remark !== "") parts.push(make("p", "faint", remark));
    return parts;
  }

  #source({ kind, name }) {
    if (kind === "agent") return [this.#mention(name)];
    if (kind === "person") return [`the person ${name.replace(/^people:/, "")}`.trim()];
    return [kind === "unknown" ? "an unknown source" : `the ${kind} ${name}`.trim()];
  }

  #mention(agent) {
    const button = make("button", "mention", `#${agent}`);
    button.addEventListener("click", () => this.#select(agent));
    return button;
  }

  #received() {
    const about = this.#about;
    const title = make("h3", "", "Received");
    if (about === null) return this.#attribute === "" ? [title, make("p", "faint", "reading the last frames …")] : [];
    if (about.problem !== undefined) return [title, make("p", "faint", about.problem)];
    const entries = about.received.map(({ frame, event, count, source }) => {
      const more = count > 1 ? ` and ${count - 1} more` : "";
      return make("li", "", `frame ${frame}: ${short(event, 90)}${more}, from `, ...this.#source(source));
    });
    const list = entries.length > 0 ? make("ul", "", ...entries) : make("p", "faint", "nothing in the last frames");
    const until = make("p", "faint", `the ten frames before frame ${about.frame}, newest first`);
    return [title, until, list, make("h3", "", "Rejected"), ...(about.rejected.length > 0 ? rejections(about.rejected) : [make("p", "faint", "nothing in these frames")])];
  }
}

const rejections = (texts) => (texts.length === 0 ? [] : [make("ul", "rejected", ...texts.map((text) => make("li", "", text)))]);
