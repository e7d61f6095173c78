/** What a person does on the page: taps, drags, keys and buttons, as orders of the world's event types. */

import { words } from "./legend.js";

const DRAG = 8; // pixels from which a touch is a drag
const ZOOM = 1.0015;

/**
 * Turns gestures on the scene into orders.
 *
 * `send(message)` gets `{order, data, to}`, `{slide, steps, to}`, `{toggle}`, `{step}` or `{rate}`;
 * `select(agent)` the agent that a person selects, or "".
 */
export class Orders {
  #scene;
  #panel;
  #send;
  #select;
  #types = {};
  #isPaused = false;
  #offered = "";
  #buttons = [];

  constructor(scene, panel, send, select) {
    this.#scene = scene;
    this.#panel = panel;
    this.#send = send;
    this.#select = select;
    this.#listen(document.getElementById("scene"));
    document.addEventListener("keydown", (event) => this.#key(event));
  }

  /** Takes the state of the world: the event types that people may send, and whether it is paused. */
  update({ types, paused }) {
    [this.#types, this.#isPaused] = [types, paused];
    const offered = JSON.stringify([types, paused]);
    if (offered === this.#offered) return;
    this.#offered = offered;
    this.#show();
  }

  /** What a tap does in this world, and to whom, for people. */
  get hint() {
    const { click, place } = this.#types;
    const texts = [click && `tap a name to send it as ${words(click.type)}`, place && `tap the ground: ${words(place)}`];
    const to = this.#to.map((agent) => ` to ${agent}`).join("");
    return texts.filter(Boolean).map((text) => `${text}${to}`).join("; ");
  }

  /** A button in the panel; errors of `act(button)` go to `onError`. */
  addButton(text, act, onError = () => {}) {
    const button = document.createElement("button");
    button.textContent = text;
    button.addEventListener("click", () => Promise.resolve(act(button)).catch(onError));
    this.#buttons.push(button);
    this.#panel.append(button);
  }

  #show() {
    const { slide, plain = [] } = this.#types;
    const own = [
      this.#button(this.#isPaused ? "resume" : "pause", () => this.#pause()),
      this.#button("step", () => this.#step()),
      this.#button("rate −", () => this.#send({ rate: -1 })),
      this.#button("rate +", () => this.#send({ rate: 1 })),
      ...plain.map((type) => this.#button(words(type), () => this.#order(type, {}))),
    ];
    if (slide) {
      own.push(this.#button(`${words(slide)} −`, () => this.#slide(-1)), this.#button(`${words(slide)} +`, () => this.#slide(1)));
    }
    this.#panel.replaceChildren(...own, ...this.#buttons.filter((button) => button.isConnected));
  }

  #button(text, act) {
    const button = document.createElement("button");
    button.textContent = text;
    button.addEventListener("click", act);
    return button;
  }

  // --- orders ---

  get #to() {
    return this.#scene.selected === "" ? [] : [this.#scene.selected];
  }

  #order(order, data) {
    this.#send({ order, data, to: this.#to });
  }

  #slide(steps) {
    this.#send({ slide: this.#types.slide, steps, to: this.#to });
  }

  #pause() {
    this.#send({ toggle: "pause" });
  }

  #step() {
    this.#send({ step: 1 });
  }

  /** A tap on a label sends its text, one on an agent selects it, one on the ground sends the place. */
  #tap(x, y) {
    const target = this.#scene.at(x, y);
    const { click, place } = this.#types;
    if (target?.text !== undefined && click) this.#order(click.type, { [click.name]: target.text });
    else if (target?.agent !== undefined) this.#select(target.agent === this.#scene.selected ? "" : target.agent);
    else if (place) {
      const [east, north] = this.#scene.metres(x, y).map((metres) => Math.round(1000 * metres) / 1000);
      this.#order(place, { x: east, y: north });
    } else this.#select("");
  }

  #key({ key, repeat, target, ctrlKey, metaKey, altKey }) {
    // A held key goes on changing a number; it neither pauses nor steps again.
    if (repeat && !["ArrowUp", "+", "ArrowDown", "-"].includes(key)) return;
    if (ctrlKey || metaKey || altKey || target instanceof HTMLInputElement) return;
    // A button that has just been hidden keeps the focus until the page is drawn again.
    if (target instanceof HTMLButtonElement && target.checkVisibility() && key !== "Escape") return;
    const acts = {
      " ": () => this.#pause(),
      n: () => this.#step(),
      ".": () => this.#step(),
      ArrowUp: () => this.#types.slide && this.#slide(1),
      "+": () => this.#types.slide && this.#slide(1),
      ArrowDown: () => this.#types.slide && this.#slide(-1),
      "-": () => this.#types.slide && this.#slide(-1),
      0: () => this.#scene.reset(),
      Escape: () => this.#select(""),
    };
    acts[key]?.();
  }

  // --- gestures ---

  #listen(canvas) {
    const touches = new Map();
    let isDrag = false;
    const place = ({ offsetX, offsetY }) => [offsetX, offsetY];
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      isDrag = touches.size > 0;
      touches.set(event.pointerId, { start: place(event), now: place(event) });
    });
    canvas.addEventListener("pointermove", (event) => {
      const touch = touches.get(event.pointerId);
      if (touch === undefined) return;
      const [before, after] = [touch.now, place(event)];
      isDrag ||= distance(touch.start, after) > DRAG;
      if (!isDrag) return;
      const other = [...touches].find(([id]) => id !== event.pointerId)?.[1].now;
      touch.now = after;
      if (other === undefined) this.#scene.move(after[0] - before[0], after[1] - before[1]);
      else {
        // Two fingers: each moves the picture by half of its own way.
        const factor = distance(other, after) / Math.max(distance(other, before), 1);
        this.#scene.move((after[0] - before[0]) / 2, (after[1] - before[1]) / 2, factor, middle(other, after));
      }
    });
    const end = (event) => {
      if (touches.delete(event.pointerId) && !isDrag && event.type === "pointerup") this.#tap(...place(event));
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.#scene.move(0, 0, ZOOM ** -event.deltaY, place(event));
    }, { passive: false });
  }
}

const distance = ([x, y], [left, top]) => Math.hypot(x - left, y - top);
const middle = ([x, y], [left, top]) => [(x + left) / 2, (y + top) / 2];
