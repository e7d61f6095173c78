/** Readings of sensors (PROTOCOL.md, section 11) as objects: `{type: "battery", robot, time, charge, volts}`. */

import { Invalid } from "./msgpack.js";

const isReal = (value) => (typeof value === "number" && !Number.isNaN(value)) || typeof value === "bigint";
const isListOf = (check) => (value) => Array.isArray(value) && value.every(check);
const isPlace = (value) => isListOf(isReal)(value) && value.length === 3;
const isSighting = (value) =>
  Array.isArray(value) && value.length === 3 && typeof value[0] === "string" && value.slice(1).every(isReal);

const CHECKS = {
  text: (value) => typeof value === "string",
  real: isReal,
  "real or nil": (value) => value === null || isReal(value),
  int: (value) => typeof value === "bigint",
  bytes: (value) => value instanceof Uint8Array,
  place: isPlace,
  sightings: isListOf(isSighting),
  motion: isListOf((value) => isListOf(isReal)(value) && value.length === 4),
};
const SCAN = [
  ["ranges", "bytes"], ["first", "real"], ["step", "real"], ["rangeMax", "real"], ["mount", "place"],
];
const FIELDS = {
  scan: SCAN,
  sweep: [...SCAN, ["beamTime", "real"], ["motion", "motion"]],
  sightings: [["seen", "sightings"]],
  image: [["encoding", "text"], ["width", "int"], ["height", "int"], ["data", "bytes"], ["mount", "place"]],
  odometry: [["x", "real"], ["y", "real"], ["angle", "real"], ["speed", "real"], ["turn", "real"]],
  battery: [["charge", "real"], ["volts", "real"]],
  position: [
    ["latitude", "real"], ["longitude", "real"], ["altitude", "real or nil"], ["accuracy", "real or nil"],
  ],
};
const fieldsOf = (type) => {
  if (!Object.hasOwn(FIELDS, type)) throw new Invalid(`no reading is called ${String(type)}`);
  return [["robot", "text"], ["time", "real"], ...FIELDS[type]];
};

function check(type, name, kind, value) {
  if (!CHECKS[kind](value)) throw new Invalid(`${name} of ${type} is not ${kind}`);
  return kind.startsWith("real") && typeof value === "bigint" ? Number(value) : value;
}

/** The reading in a message. */
export function readReading(plain) {
  if (!Array.isArray(plain) || typeof plain[0] !== "string") throw new Invalid("not a reading");
  const [type, ...items] = plain;
  const fields = fieldsOf(type);
  if (items.length !== fields.length) throw new Invalid(`${type} has ${fields.length} items`);
  const entries = fields.map(([name, kind], n) => [name, check(type, name, kind, items[n])]);
  return { type, ...Object.fromEntries(entries) };
}

/** A reading as it is sent. */
export function writeReading(reading) {
  return [reading.type, ...fieldsOf(reading.type).map(([name, kind]) => check(reading.type, name, kind, reading[name]))];
}
