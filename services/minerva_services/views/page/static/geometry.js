/** The geometric system of the page: what a string draws, by the forms that its vocabulary declares. */

const RADIANS = Math.PI / 180;

/** A position in metres and a direction in degrees, counter-clockwise from the x axis. */
const ORIGIN = { x: 0, y: 0, angle: 0 };

/** The pose that a motion leads to: shifted by (x, y), turned, then forward along the new x axis. */
function moved({ x, y, angle }, [dx, dy, turn, forward]) {
  const [cos, sin] = direction(angle);
  const [left, up] = [x + dx * cos - dy * sin, y + dx * sin + dy * cos];
  const [cosAfter, sinAfter] = direction(angle + turn);
  return { x: left + forward * cosAfter, y: up + forward * sinAfter, angle: angle + turn };
}

const direction = (angle) => [Math.cos(angle * RADIANS), Math.sin(angle * RADIANS)];

/** A point given relative to a pose. */
export function pointAt(pose, x, y) {
  const { x: left, y: up } = moved(pose, [x, y, 0, 0]);
  return [left, up];
}

const number = (measure, values) => Number(typeof measure === "string" ? values[measure] : measure);

const SCALED = /^(\w+|#[#\w ]+)\( *(\w+) *, *([-+.\w]+) *, *([-+.\w]+) *\)$/;

/** The scale that a disc's colour names, such as `viridis(age, 0, 10)`; null for a plain colour. */
export function scaleOf(colour, scales) {
  const read = SCALED.exec(colour);
  if (read === null) return null;
  const [, name, parameter, ...ends] = read;
  const [low, high] = ends.map(Number);
  const own = name.startsWith("#") ? name.trim().split(/ +/) : null;
  const colours = own ?? scales[name].slice(0, name === "groups" ? high - low : undefined);
  return { parameter, low, high, colours, isGrouped: own !== null || name === "groups" };
}

function shade(colour, values, scales) {
  const scale = scaleOf(colour, scales);
  if (scale === null) return colour;
  const { parameter, low, high, colours } = scale;
  const place = Math.floor(((Number(values[parameter]) - low) / (high - low)) * colours.length);
  return colours[Math.max(0, Math.min(place, colours.length - 1))];
}

/**
 * What a string draws, in its order: discs, lines, rasters, labels and marks.
 *
 * Each item has its `form`, `symbol`, `colour`, and `agent`, the id of its agent or "". Positions are
 * in metres. `scales` are the colours of the named scales.
 */
export function displayList(nodes, vocabulary, scales) {
  const items = [];
  // A stack in place of recursion, because strings may be deep.
  const waiting = nodes.map((node) => ({ node, pose: ORIGIN, agent: node.agent ?? "" })).reverse();
  while (waiting.length > 0) {
    const { node, pose, agent } = waiting.pop();
    const form = vocabulary.forms.get(node.symbol) ?? null;
    if (node.scope === undefined) {
      if (form !== null) items.push(item(form, node, pose, agent, vocabulary, scales));
      continue;
    }
    const motion = form === null ? [0, 0, 0, 0] : form.slice(1).map((measure) => number(measure, node.values));
    const inner = moved(pose, motion);
    for (const child of [...node.scope].reverse()) {
      waiting.push({ node: child, pose: inner, agent: node.id ?? child.agent ?? agent });
    }
  }
  return items;
}

const DRAWN = {
  disc: ([radius, colour, heading], { values }, pose, scales) => ({
    ...pose, radius: number(radius, values), colour: shade(colour, values, scales), heading,
  }),
  line: ([xs, ys, colour, width, dashed], { values }, pose) => {
    const count = Math.min(values[xs].length, values[ys].length);
    const points = Array.from({ length: count }, (_, n) => pointAt(pose, Number(values[xs][n]), Number(values[ys][n])));
    return { points, colour, width, dashed };
  },
  raster: ([cells, cell, x, y, turn, colours, opacity], { values }, pose) => ({
    ...moved(pose, [x, y, turn, 0].map((measure) => number(measure, values))),
    cell: number(cell, values), matrix: matrix(values[cells]), colours, opacity,
  }),
  label: ([text, colour], { values }, { x, y }) => ({ x, y, text: String(values[text]), colour }),
};

function item([form, ...measures], node, pose, agent, vocabulary, scales) {
  const isMark = form === "label" && vocabulary.marks.has(node.symbol);
  const name = nameOf(node, vocabulary);
  // Figures of a population have the id of their agent as name, if they have one.
  const owner = { symbol: node.symbol, agent: agent === "~" ? name : agent, name };
  return { ...owner, form: isMark ? "mark" : form, ...DRAWN[form]?.(measures, node, pose, scales) };
}

/** The first text among the parameters of a figure, by which it is named. */
function nameOf({ symbol, values }, vocabulary) {
  const field = vocabulary.fields(symbol).find(([, type]) => type.split(" ")[0] === "text");
  return field === undefined ? "" : String(values[field[0]]);
}

const matrices = new WeakMap();

/** The numbers of a matrix (extension 1 of the protocol), row by row; read once. */
function matrix(extension) {
  let known = matrices.get(extension);
  if (known === undefined) {
    const { data } = extension;
    const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
    const [rows, columns] = [view.getUint32(1, true), view.getUint32(5, true)];
    const isReal = data[0] === 0x72;
    const at = (n) => (isReal ? view.getFloat64(9 + 8 * n, true) : view.getInt16(9 + 2 * n, true));
    known = { rows, columns, values: Float64Array.from({ length: rows * columns }, (_, n) => at(n)) };
    matrices.set(extension, known);
  }
  return known;
}

/** The colour of a number among pairs [least value, colour]; "" draws nothing. */
export function colourOf(value, colours) {
  let colour = "";
  for (const [least, each] of colours) if (value >= least) colour = each;
  return colour;
}

/** The corners of a raster. */
export function corners({ matrix: { rows, columns }, cell, ...pose }) {
  return [[0, 0], [rows, 0], [0, columns], [rows, columns]].map(([row, column]) => pointAt(pose, row * cell, column * cell));
}

/**
 * The part of the world to show: all rasters or, without any, everything drawn, which only grows.
 *
 * `{left, bottom, right, top}` in metres.
 */
export function frameOf(items, before = null) {
  const rasters = items.filter(({ form }) => form === "raster");
  if (rasters.length > 0) return box(rasters.flatMap(corners));
  const points = items.flatMap(outline);
  if (points.length === 0) return before ?? { left: -1, bottom: -1, right: 1, top: 1 };
  const all = box(points);
  if (before !== null && contains(before, all)) return before;
  const side = Math.max(all.right - all.left, all.top - all.bottom);
  const largest = items.reduce((radius, item) => Math.max(radius, item.radius ?? 0), 0);
  const margin = Math.max(0.05 * side, 3 * largest, side > 1e-6 ? 0 : 1);
  const wider = box([[all.left - margin, all.bottom - margin], [all.right + margin, all.top + margin]]);
  return before === null ? wider : box([...cornersOf(before), ...cornersOf(wider)]);
}

function outline(item) {
  if (item.form === "line") return item.points;
  if (item.form === "label") return [[item.x, item.y]];
  if (item.form !== "disc") return [];
  const { x, y, radius } = item;
  return [[x - radius, y - radius], [x + radius, y + radius]];
}

function box(points) {
  // Without spreading, because a line may have more points than a function takes arguments.
  const result = { left: Infinity, bottom: Infinity, right: -Infinity, top: -Infinity };
  for (const [x, y] of points) {
    result.left = Math.min(result.left, x);
    result.right = Math.max(result.right, x);
    result.bottom = Math.min(result.bottom, y);
    result.top = Math.max(result.top, y);
  }
  return result;
}

const cornersOf = ({ left, bottom, right, top }) => [[left, bottom], [right, top]];
const contains = (outer, inner) =>
  outer.left <= inner.left && outer.bottom <= inner.bottom && outer.right >= inner.right && outer.top >= inner.top;
