/** Random streams that depend on seed, name and frame alone (docs/reference/protocol/streams.md). */

import { blake2b } from "./blake2b.js";

const MASK = (1n << 64n) - 1n;
const GAMMA = 0x9e3779b97f4a7c15n;
const encoder = new TextEncoder();

const little = (bytes) => bytes.reduceRight((number, byte) => (number << 8n) | BigInt(byte), 0n);

/** The hash that all agents of a frame share, kept for the next agent: it costs more than all else. */
const keys = new Map();
const MOST_KEYS = 64;

/** 8 bytes of BLAKE2b over the parts, separated by NUL. */
function keyed(...parts) {
  const text = parts.join("\0");
  let key = keys.get(text);
  if (key === undefined) {
    key = little(blake2b(text, 8));
    if (keys.size >= MOST_KEYS) keys.clear();
    keys.set(text, key);
  }
  return key;
}

export function mix(z) {
  z = ((z ^ (z >> 30n)) * 0xbf58476d1ce4e5b9n) & MASK;
  z = ((z ^ (z >> 27n)) * 0x94d049bb133111ebn) & MASK;
  return z ^ (z >> 31n);
}

/** The polynomial hash of an id. */
export function hashOf(id) {
  return encoder.encode(id).reduce((hash, byte) => (hash * GAMMA + BigInt(byte)) & MASK, 0n);
}

const fraction = (word) => Number(word >> 11n) * 2 ** -53;

/** SplitMix64. */
export class SplitMix64 {
  constructor(word) {
    this.word = word;
  }

  /** The next number, from 0 to less than 1. */
  next() {
    this.word = (this.word + GAMMA) & MASK;
    return fraction(mix(this.word));
  }
}

/** The stream of an agent in a frame; with an event type the one that decides about its events. */
export function agentStream(seed, frame, id, ...eventType) {
  return new SplitMix64(mix(hashOf(id) ^ keyed(seed, frame, ...eventType)));
}

/** Philox4x64-10 with the key of (seed, who, frame), as the Python members draw from it. */
export class Philox {
  constructor(seed, who, frame) {
    const key = little(blake2b([seed, who, frame].join("\0"), 16));
    this.key = [key & MASK, key >> 64n];
    this.block = 0n;
    this.words = [];
  }

  word() {
    if (this.words.length === 0) this.words = this.#nextBlock();
    return this.words.shift();
  }

  /** The next number, from 0 to less than 1. */
  next() {
    return fraction(this.word());
  }

  #nextBlock() {
    this.block += 1n;
    let c = [this.block, 0n, 0n, 0n];
    let [k0, k1] = this.key;
    for (let round = 0; round < 10; round++) {
      const p0 = 0xd2e7470ee14c6c93n * c[0];
      const p1 = 0xca5a826395121157n * c[2];
      c = [(p1 >> 64n) ^ c[1] ^ k0, p1 & MASK, (p0 >> 64n) ^ c[3] ^ k1, p0 & MASK];
      k0 = (k0 + GAMMA) & MASK;
      k1 = (k1 + 0xbb67ae8584caa73bn) & MASK;
    }
    return c;
  }
}
