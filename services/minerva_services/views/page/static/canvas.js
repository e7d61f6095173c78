/** Draws display lists on a canvas, and finds what is at a point of it. */

import { colourOf, frameOf } from "./geometry.js";

const PAPER = "#fbfaf6";
const INK = "#2f3640";
const FAINT = "#6d6657";
const CHOSEN = "#1f7a8c";
const FILLED = 0.94; // of the canvas, by the whole world
const MOST_NAMES = 24;
const MOST_AGENTS = 500; // offered by id
const LEAST_RADIUS = 3; // pixels
const TOUCH = 24; // pixels: the least radius of what a finger touches
/** The mark on discs with a heading: distances in radii, directions in radians. */
const HEADING = [[0.78, 0], [0.7, 140], [0.28, 180], [0.7, -140]].map(([far, turn]) => [far, (turn * Math.PI) / 180]);
const PIN = "M0 0L-6.6-12.4a8 8 0 1 1 13.2 0z";

/** A canvas that shows a part of the world; dragging and zooming change the part. */
export class Scene {
  #canvas;
  #context;
  #items = [];
  #frame = null;
  #own = null; // the part that a user has chosen: centre in metres, pixels per metre
  #images = new WeakMap();
  #labels = [];
  #isDue = false;
  selected = "";

  constructor(canvas) {
    this.#canvas = canvas;
    this.#context = canvas.getContext("2d");
    new ResizeObserver(() => this.#due()).observe(canvas);
  }

  /** Shows items; drawing waits for the browser's next frame. */
  show(items) {
    this.#items = items;
    this.#frame = frameOf(items, this.#frame);
    this.#due();
  }

  /** The ids of the agents that are drawn, sorted. */
  get agents() {
    const ids = this.#items.map(({ agent }) => agent).filter((agent) => agent && !agent.startsWith("~"));
    return [...new Set(ids)].sort().slice(0, MOST_AGENTS);
  }

  select(agent) {
    this.selected = agent;
    this.#due();
  }

  /** Shows the whole world again. */
  reset() {
    this.#own = null;
    this.#due();
  }

  /** Moves the picture by pixels, and enlarges it by a factor around a pixel. */
  move(dx, dy, factor = 1, [x, y] = [0, 0]) {
    const { scale, centre } = this.#part();
    const [left, up] = this.metres(x, y);
    const at = [left + (centre[0] - left) / factor, up + (centre[1] - up) / factor];
    this.#own = { scale: scale * factor, centre: [at[0] - dx / (scale * factor), at[1] + dy / (scale * factor)] };
    this.#due();
  }

  /** The point of the world at a pixel. */
  metres(x, y) {
    const { scale, centre } = this.#part();
    const { width, height } = this.#size();
    return [centre[0] + (x - width / 2) / scale, centre[1] - (y - height / 2) / scale];
  }

  /** What is at a pixel: `{text}` of a label, `{agent}`, or null. */
  at(x, y) {
    const label = this.#labels.find(({ box: [left, top, right, bottom] }) => x >= left && x <= right && y >= top && y <= bottom);
    if (label !== undefined) return { text: label.text };
    let nearest = { distance: Infinity, agent: "" };
    for (const item of this.#items) {
      if (item.form !== "disc" || item.agent === "") continue;
      const [left, top] = this.#pixel(item.x, item.y);
      const [far, radius] = [Math.hypot(left - x, top - y), this.#radius(item)];
      const distance = far - radius;
      if (far < Math.max(TOUCH, radius) && distance < nearest.distance) nearest = { distance, agent: item.agent };
    }
    return nearest.agent === "" ? null : { agent: nearest.agent };
  }

  /** Where an agent's first disc is, in pixels; null without one. */
  pixelOf(agent) {
    const disc = this.#items.find((item) => item.form === "disc" && item.agent === agent);
    return disc === undefined ? null : this.#pixel(disc.x, disc.y);
  }

  // --- the part of the world that is shown ---

  #size() {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    return { width: Math.max(width, 1), height: Math.max(height, 1) };
  }

  #part() {
    if (this.#own !== null) return this.#own;
    const { left, bottom, right, top } = this.#frame ?? { left: -1, bottom: -1, right: 1, top: 1 };
    const { width, height } = this.#size();
    const scale = Math.min(width / (right - left), height / (top - bottom)) * FILLED;
    // At the top of a high canvas: panels on a phone cover the bottom.
    return { scale, centre: [(left + right) / 2, top - (height * FILLED) / 2 / scale] };
  }

  #pixel(x, y) {
    const { scale, centre } = this.#part();
    const { width, height } = this.#size();
    return [width / 2 + (x - centre[0]) * scale, height / 2 - (y - centre[1]) * scale];
  }

  // On the map of a city a robot would be smaller than a pixel and vanish.
  #radius({ radius }) {
    return Math.max(radius * this.#part().scale, LEAST_RADIUS);
  }

  // --- drawing ---

  #due() {
    if (this.#isDue) return;
    this.#isDue = true;
    requestAnimationFrame(() => {
      this.#isDue = false;
      this.#draw();
    });
  }

  #draw() {
    const { width, height } = this.#size();
    const dense = window.devicePixelRatio || 1;
    if (this.#canvas.width !== Math.round(width * dense) || this.#canvas.height !== Math.round(height * dense)) {
      [this.#canvas.width, this.#canvas.height] = [Math.round(width * dense), Math.round(height * dense)];
    }
    const context = this.#context;
    context.setTransform(dense, 0, 0, dense, 0, 0);
    context.fillStyle = PAPER;
    context.fillRect(0, 0, width, height);
    // What agents know of the ground must not cover other agents.
    const of = (...forms) => this.#items.filter(({ form }) => forms.includes(form));
    for (const raster of of("raster")) this.#raster(raster, dense);
    this.#grid();
    for (const item of of("disc", "line")) item.form === "disc" ? this.#disc(item) : this.#line(item);
    this.#names(of("disc").filter(({ heading, name }) => heading && name));
    const marked = new Map(of("mark").map(({ text, colour }) => [text, colour]));
    this.#labels = of("label").map((label) => this.#label(label, marked.get(label.text)));
  }

  #raster({ x, y, angle, cell, matrix, colours, opacity }, dense) {
    const context = this.#context;
    const { scale } = this.#part();
    const [left, top] = this.#pixel(x, y);
    context.save();
    context.globalAlpha = opacity;
    context.imageSmoothingEnabled = false;
    context.translate(left, top);
    context.rotate((-angle * Math.PI) / 180);
    // A row of the matrix lies along x, a column along y, which goes up.
    context.scale(scale * cell, -scale * cell);
    context.drawImage(this.#image(matrix, colours), 0, 0, matrix.rows, matrix.columns);
    context.restore();
    context.setTransform(dense, 0, 0, dense, 0, 0);
  }

  #image(matrix, colours) {
    let image = this.#images.get(matrix);
    if (image !== undefined) return image;
    const { rows, columns, values } = matrix;
    image = document.createElement("canvas");
    [image.width, image.height] = [Math.max(rows, 1), Math.max(columns, 1)];
    const context = image.getContext("2d");
    const pixels = context.createImageData(image.width, image.height);
    const shades = new Map();
    values.forEach((value, place) => {
      const colour = colourOf(value, colours);
      if (colour === "") return;
      if (!shades.has(colour)) shades.set(colour, [1, 3, 5].map((digit) => parseInt(colour.slice(digit, digit + 2), 16)));
      const [row, column] = [Math.floor(place / columns), place % columns];
      pixels.data.set([...shades.get(colour), 255], 4 * (column * image.width + row));
    });
    context.putImageData(pixels, 0, 0);
    this.#images.set(matrix, image);
    return image;
  }

  #grid() {
    const { width, height } = this.#size();
    const step = gridStep(width / this.#part().scale / 12);
    const [left, top] = this.metres(0, 0);
    const [right, bottom] = this.metres(width, height);
    const context = this.#context;
    context.beginPath();
    for (let x = Math.ceil(left / step); x <= right / step; x++) {
      const [at] = this.#pixel(x * step, 0);
      context.moveTo(at, 0);
      context.lineTo(at, height);
    }
    for (let y = Math.ceil(bottom / step); y <= top / step; y++) {
      const [, at] = this.#pixel(0, y * step);
      context.moveTo(0, at);
      context.lineTo(width, at);
    }
    context.strokeStyle = "rgb(47 54 64 / 8%)";
    context.lineWidth = 1;
    context.stroke();
    this.#scaleBar(step * this.#part().scale, `${Number(step.toPrecision(1))} m`);
  }

  /** How long a step of the grid is, in the lower right corner. */
  #scaleBar(length, text) {
    const context = this.#context;
    const { width, height } = this.#size();
    const [right, y] = [width - 12, height - 12];
    context.beginPath();
    context.moveTo(right - length, y - 4);
    context.lineTo(right - length, y);
    context.lineTo(right, y);
    context.lineTo(right, y - 4);
    context.strokeStyle = FAINT;
    context.stroke();
    this.#text(text, right - length / 2, y - 7, "center", FAINT);
  }

  #disc(item) {
    const context = this.#context;
    const [x, y] = this.#pixel(item.x, item.y);
    const radius = this.#radius(item);
    circle(context, x, y, radius);
    context.fillStyle = item.colour;
    context.fill();
    context.lineWidth = Math.min(1.6, radius / 3);
    context.strokeStyle = "rgb(29 35 43 / 55%)";
    context.stroke();
    if (item.heading) {
      context.beginPath();
      for (const [far, turn] of HEADING) {
        const angle = (item.angle * Math.PI) / 180 + turn;
        context.lineTo(x + far * radius * Math.cos(angle), y - far * radius * Math.sin(angle));
      }
      context.fillStyle = "rgb(255 255 255 / 95%)";
      context.fill();
    }
    if (item.agent !== "" && item.agent === this.selected) {
      circle(context, x, y, radius + 4);
      context.lineWidth = 3;
      context.strokeStyle = CHOSEN;
      context.stroke();
    }
  }

  #line({ points, colour, width, dashed }) {
    const context = this.#context;
    const wide = Math.max(width * this.#part().scale, 1.5);
    context.beginPath();
    for (const [x, y] of points) context.lineTo(...this.#pixel(x, y));
    context.lineWidth = wide;
    context.lineJoin = context.lineCap = "round";
    context.setLineDash(dashed ? [2.5 * wide, 2.5 * wide] : []);
    context.strokeStyle = colour;
    context.stroke();
    context.setLineDash([]);
  }

  #names(discs) {
    if (new Set(discs.map(({ name }) => name)).size > MOST_NAMES) return;
    for (const disc of discs) {
      const [x, y] = this.#pixel(disc.x, disc.y);
      this.#text(disc.name, x, y - this.#radius(disc) - 5, "center", INK);
    }
  }

  /** A label on a pin, whose tip is at the position; returns its text and box in pixels. */
  #label({ x, y, text, colour }, marked) {
    const context = this.#context;
    const [left, top] = this.#pixel(x, y);
    const scale = marked ? 1.15 : 0.9;
    context.save();
    context.translate(left, top);
    context.scale(scale, scale);
    context.fillStyle = marked ?? colour;
    context.strokeStyle = "#fff";
    context.lineWidth = 1.2;
    const pin = new Path2D(PIN);
    context.fill(pin);
    context.stroke(pin);
    circle(context, 0, -17, 3);
    context.fillStyle = "#fff";
    context.fill();
    context.restore();
    const width = this.#width(text);
    const isRight = left + 12 + width < this.#size().width;
    this.#text(text, left + (isRight ? 11 : -11), top - 9, isRight ? "left" : "right", marked ?? INK);
    const ends = isRight ? [left - 10, left + 14 + width] : [left - 14 - width, left + 10];
    return { text, box: [ends[0], top - 28, ends[1], top + 6] };
  }

  #width(text) {
    this.#context.font = FONT;
    return this.#context.measureText(text).width;
  }

  #text(text, x, y, align, colour) {
    const context = this.#context;
    context.font = FONT;
    context.textAlign = align;
    context.lineJoin = "round";
    context.lineWidth = 3.5;
    context.strokeStyle = "#fff";
    context.strokeText(text, x, y);
    context.fillStyle = colour;
    context.fillText(text, x, y);
  }
}

const FONT = "600 14px system-ui, sans-serif";

function circle(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
}

/** The smallest of 1, 2 or 5 times a power of ten that is not below a length. */
function gridStep(wanted) {
  const power = 10 ** Math.floor(Math.log10(wanted));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= wanted) ?? 10 * power;
}
