/** BLAKE2b (RFC 7693), which no browser has, and Node only with 64 bytes of output. */

const BLOCK = 128; // bytes
const INITIAL = [
  0x6a09e667f3bcc908n, 0xbb67ae8584caa73bn, 0x3c6ef372fe94f82bn, 0xa54ff53a5f1d36f1n,
  0x510e527fade682d1n, 0x9b05688c2b3e6c1fn, 0x1f83d9abfb41bd6bn, 0x5be0cd19137e2179n,
];
const ORDERS = [
  "0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d",
  "2c6a0b834d75fe19", "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0",
  "0123456789abcdef", "ea489fd61c02b753",
].map((digits) => [...digits].map((digit) => 2 * parseInt(digit, 16)));
const COLUMNS_AND_DIAGONALS = [
  [0, 4, 8, 12], [1, 5, 9, 13], [2, 6, 10, 14], [3, 7, 11, 15],
  [0, 5, 10, 15], [1, 6, 11, 12], [2, 7, 8, 13], [3, 4, 9, 14],
].map((places) => places.map((place) => 2 * place));

// A word is two numbers of 32 bits, the lower half first: with BigInts a hash takes far longer.
const initial = Uint32Array.from(INITIAL.flatMap((word) => [Number(word & 0xffffffffn), Number(word >> 32n)]));
const v = new Uint32Array(32);
const words = new Uint32Array(32);
const encoder = new TextEncoder();

/** v[a] += v[b]. */
function add(a, b) {
  const low = v[a] + v[b];
  v[a + 1] += v[b + 1] + (low >= 2 ** 32 ? 1 : 0);
  v[a] = low;
}

/** v[a] += a word of the block. */
function addWord(a, place) {
  const low = v[a] + words[place];
  v[a + 1] += words[place + 1] + (low >= 2 ** 32 ? 1 : 0);
  v[a] = low;
}

/** v[a] ^= v[b], then rotated to the right by less than 32 bits, and by 32 more if `swapped`. */
function turn(a, b, bits, swapped) {
  let low = v[a] ^ v[b];
  let high = v[a + 1] ^ v[b + 1];
  if (swapped) [low, high] = [high, low];
  v[a] = bits === 0 ? low : (low >>> bits) | (high << (32 - bits));
  v[a + 1] = bits === 0 ? high : (high >>> bits) | (low << (32 - bits));
}

function compress(state, length, last) {
  v.set(state);
  v.set(initial, 16);
  v[24] ^= length;
  v[25] ^= length / 2 ** 32;
  if (last) {
    v[28] ^= 0xffffffff;
    v[29] ^= 0xffffffff;
  }
  for (const order of ORDERS) {
    for (let n = 0; n < 8; n++) {
      const [a, b, c, d] = COLUMNS_AND_DIAGONALS[n];
      add(a, b);
      addWord(a, order[2 * n]);
      turn(d, a, 0, true);
      add(c, d);
      turn(b, c, 24, false);
      add(a, b);
      addWord(a, order[2 * n + 1]);
      turn(d, a, 16, false);
      add(c, d);
      turn(b, c, 31, true);
    }
  }
  for (let n = 0; n < 16; n++) state[n] ^= v[n] ^ v[n + 16];
}

/** BLAKE2b of bytes, or of a text in UTF-8, without a key; `size` is the number of bytes of output. */
export function blake2b(input, size) {
  const data = typeof input === "string" ? encoder.encode(input) : input;
  const state = initial.slice();
  state[0] ^= 0x01010000 ^ size;
  const block = new DataView(new ArrayBuffer(BLOCK));
  const bytes = new Uint8Array(block.buffer);
  for (let at = 0; at === 0 || at < data.length; at += BLOCK) {
    const end = Math.min(at + BLOCK, data.length);
    bytes.fill(0);
    bytes.set(data.subarray(at, end));
    for (let n = 0; n < 32; n++) words[n] = block.getUint32(4 * n, true);
    compress(state, end, end === data.length);
  }
  const result = new DataView(new ArrayBuffer(64));
  state.forEach((half, n) => result.setUint32(4 * n, half, true));
  return new Uint8Array(result.buffer, 0, size);
}

/** The digits of bytes. */
export const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
