/** Random streams that depend on seed, name and frame alone (PROTOCOL.md, P9.24 to P9.30). */

const MASK = (1n << 64n) - 1n;
const GAMMA = 0x9e3779b97f4a7c15n;
const encoder = new TextEncoder();

// BLAKE2b (RFC 7693), which no browser has, and Node only with 64 bytes of output.
const INITIAL = [
  0x6a09e667f3bcc908n, 0xbb67ae8584caa73bn, 0x3c6ef372fe94f82bn, 0xa54ff53a5f1d36f1n,
  0x510e527fade682d1n, 0x9b05688c2b3e6c1fn, 0x1f83d9abfb41bd6bn, 0x5be0cd19137e2179n,
];
const ORDERS = [
  "0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d",
  "2c6a0b834d75fe19", "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0",
  "0123456789abcdef", "ea489fd61c02b753",
].map((digits) => [...digits].map((digit) => parseInt(digit, 16)));
const COLUMNS_AND_DIAGONALS = [
  [0, 4, 8, 12], [1, 5, 9, 13], [2, 6, 10, 14], [3, 7, 11, 15],
  [0, 5, 10, 15], [1, 6, 11, 12], [2, 7, 8, 13], [3, 4, 9, 14],
];

const rotated = (word, bits) => (word >> bits) | ((word << (64n - bits)) & MASK);

function compress(state, block, length, last) {
  const view = new DataView(block.buffer, block.byteOffset, 128);
  const words = Array.from({ length: 16 }, (_, n) => view.getBigUint64(8 * n, true));
  const v = [...state, ...INITIAL];
  v[12] ^= BigInt(length);
  if (last) v[14] ^= MASK;
  for (const order of ORDERS) {
    COLUMNS_AND_DIAGONALS.forEach(([a, b, c, d], n) => {
      v[a] = (v[a] + v[b] + words[order[2 * n]]) & MASK;
      v[d] = rotated(v[d] ^ v[a], 32n);
      v[c] = (v[c] + v[d]) & MASK;
      v[b] = rotated(v[b] ^ v[c], 24n);
      v[a] = (v[a] + v[b] + words[order[2 * n + 1]]) & MASK;
      v[d] = rotated(v[d] ^ v[a], 16n);
      v[c] = (v[c] + v[d]) & MASK;
      v[b] = rotated(v[b] ^ v[c], 63n);
    });
  }
  return state.map((word, n) => word ^ v[n] ^ v[n + 8]);
}

/** BLAKE2b of a text in UTF-8, without a key. */
export function blake2b(text, size) {
  const data = encoder.encode(text);
  let state = [...INITIAL];
  state[0] ^= 0x01010000n ^ BigInt(size);
  const blocks = Math.max(1, Math.ceil(data.length / 128));
  for (let n = 0; n < blocks; n++) {
    const block = new Uint8Array(128);
    block.set(data.subarray(128 * n, 128 * (n + 1)));
    const last = n === blocks - 1;
    state = compress(state, block, last ? data.length : 128 * (n + 1), last);
  }
  const result = new DataView(new ArrayBuffer(64));
  state.forEach((word, n) => result.setBigUint64(8 * n, word, true));
  return new Uint8Array(result.buffer, 0, size);
}

const little = (bytes) => bytes.reduceRight((number, byte) => (number << 8n) | BigInt(byte), 0n);

/** The first state of a stream: 8 bytes of BLAKE2b over the parts, separated by NUL. */
/** The hash that all agents of a frame share, kept for the next agent: it costs more than all else. */
const keys = new Map();
const MOST_KEYS = 64;

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
