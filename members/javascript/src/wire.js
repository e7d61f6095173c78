/** Zenoh's messages as bytes, as far as a client in the members' role needs them (docs/reference/protocol/zenoh-wire.md). */

const VERSION = 9;
const CLIENT = 0x02;
const RESOLUTIONS = 0x0a; // sequence numbers and request ids of 32 bits
const SEQUENCE_MASK = 0x0fffffff; // such a sequence number is written in at most four bytes
const RELIABLE = 0x20;
const MORE = 0x40;
const EXTENSIONS = 0x80;
const LAST_TRANSPORT = 0x07; // JOIN; network messages have numbers from 0x19 on
const BLOCK_AT_DATA_PRIORITY = 0x0d;

const TOKENS = 0x08;
const RESTRICTED = 0x10;
const NAMED = 0x20;

const utf8 = new TextDecoder();
const encoder = new TextEncoder();

/** Bytes that are no message of Zenoh's. */
export class WireError extends Error {}

// --- writing ---

/** LEB128 of a number below 2^53. */
export function zint(number) {
  const bytes = [];
  while (number >= 0x80) {
    bytes.push((number % 0x80) | 0x80);
    number = Math.floor(number / 0x80);
  }
  return [...bytes, number];
}

const slice = (bytes) => [...zint(bytes.length), ...bytes];
const keyExpression = (key) => [0, ...slice(encoder.encode(key))];

function joined(...parts) {
  const result = new Uint8Array(parts.reduce((size, part) => size + part.length, 0));
  let at = 0;
  for (const part of parts) {
    result.set(part, at);
    at += part.length;
  }
  return result;
}

/** INIT: the identity of this session and the largest batch that it takes. */
export function init(id, batchSize) {
  const size = [batchSize & 0xff, batchSize >> 8];
  return Uint8Array.of(0x41, VERSION, ((id.length - 1) << 4) | CLIENT, ...id, RESOLUTIONS, ...size);
}

/** OPEN: the lease in seconds, the first sequence number, and the cookie of the answer to INIT. */
export function open(lease, sequence, cookie) {
  return Uint8Array.of(0x42, ...zint(lease), ...zint(sequence), ...slice(cookie));
}

export const keepAlive = () => Uint8Array.of(0x04);

/** CLOSE of the session, for no particular reason. */
export const close = () => Uint8Array.of(0x23, 0x00);

/** The batches that carry a network message from a sequence number on: one FRAME, or FRAGMENTs. */
export function batches(message, sequence, batchSize) {
  const room = batchSize - 6; // a header and a sequence number of at most five bytes
  if (message.length <= room) return [joined([0x05 | RELIABLE, ...zint(sequence)], message)];
  const result = [];
  for (let at = 0; at < message.length; at += room) {
    const more = at + room < message.length ? MORE : 0;
    const number = after(sequence, result.length);
    result.push(joined([0x06 | RELIABLE | more, ...zint(number)], message.subarray(at, at + room)));
  }
  return result;
}

/** The sequence number `count` places after one. */
export const after = (sequence, count) => (sequence + count) & SEQUENCE_MASK;

/** PUSH of a payload, which the router must not drop. */
export function put(key, payload) {
  const head = [0x1d | NAMED | EXTENSIONS, ...keyExpression(key), 0x21, BLOCK_AT_DATA_PRIORITY, 0x01];
  return joined(head, zint(payload.length), payload);
}

const declaration = (id, number, key) => Uint8Array.of(0x1e, id | NAMED, ...zint(number), ...keyExpression(key));

export const declareSubscriber = (number, key) => declaration(0x02, number, key);
export const declareToken = (number, key) => declaration(0x06, number, key);
export const undeclareToken = (number) => Uint8Array.of(0x1e, 0x07, ...zint(number));

/** INTEREST in the liveliness tokens of a key: those that exist, and with `future` those to come. */
export function interestInTokens(number, key, future) {
  const header = 0x19 | 0x20 | (future ? 0x40 : 0);
  const options = 0x01 | TOKENS | RESTRICTED | NAMED;
  return Uint8Array.of(header, ...zint(number), options, ...keyExpression(key));
}

// --- reading ---

class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  get isEmpty() {
    return this.at >= this.bytes.length;
  }

  byte() {
    if (this.isEmpty) throw new WireError("a message is cut off");
    return this.bytes[this.at++];
  }

  /** An integer; those above 2^53 are only skipped, so their value does not matter. */
  zint() {
    let number = 0;
    for (let factor = 1; ; factor *= 0x80) {
      const byte = this.byte();
      number += (byte & 0x7f) * factor;
      if (byte < 0x80) return number;
    }
  }

  take(length) {
    if (length > this.bytes.length - this.at) throw new WireError("a message is cut off");
    this.at += length;
    return this.bytes.subarray(this.at - length, this.at);
  }

  slice() {
    return this.take(this.zint());
  }

  rest() {
    return this.take(this.bytes.length - this.at);
  }

  /** The bodies of extensions of type slice by id, if the header announces extensions. */
  extensions(header) {
    const bodies = new Map();
    let more = (header & EXTENSIONS) !== 0;
    while (more) {
      const head = this.byte();
      const type = (head >> 5) & 0x03;
      if (type === 1) this.zint();
      else if (type === 2) bodies.set(head & 0x0f, this.slice());
      else if (type === 3) throw new WireError("an extension of an unknown type");
      more = (head & 0x80) !== 0;
    }
    return bodies;
  }

  /** A key expression: the number of a declared one, 0 for none, and what follows it. */
  key(header) {
    const mapping = this.zint();
    return { mapping, suffix: header & NAMED ? utf8.decode(this.slice()) : "" };
  }
}

/** The transport message in a batch; FRAMEs have their network messages in `body`. */
export function readBatch(bytes) {
  const reader = new Reader(bytes);
  const header = reader.byte();
  switch (header & 0x1f) {
    case 0x01: return { type: "init", ...readInit(reader, header) };
    case 0x02: return { type: "open", lease: reader.zint() * (header & 0x40 ? 1000 : 1), sequence: reader.zint() };
    case 0x03: return { type: "close" };
    case 0x04: return { type: "keepAlive", body: afterKeepAlive(reader, header) };
    case 0x05: case 0x06: {
      reader.zint();
      reader.extensions(header);
      const type = (header & 0x1f) === 0x05 ? "frame" : "fragment";
      return { type, more: (header & MORE) !== 0, body: reader.rest() };
    }
    default: throw new WireError(`the transport message ${header & 0x1f} is unknown`);
  }
}

/** Several transport messages may share a batch; only small ones stand before others. */
function afterKeepAlive(reader, header) {
  reader.extensions(header);
  return reader.rest();
}

function readInit(reader, header) {
  const version = reader.byte();
  const flags = reader.byte();
  const id = reader.take((flags >> 4) + 1);
  let batchSize = 0xffff;
  if (header & 0x40) {
    reader.byte();
    batchSize = reader.byte() | (reader.byte() << 8);
  }
  return { version, id, batchSize, cookie: reader.slice() };
}

/**
 * The network messages in the body of a FRAME. Further transport messages may share its batch, such as
 * the CLOSE of a router that ends: they come last, as one of type `batch`.
 */
export function* readMessages(body) {
  const reader = new Reader(body);
  while (!reader.isEmpty) {
    const start = reader.at;
    const header = reader.byte();
    if ((header & 0x1f) <= LAST_TRANSPORT) return yield { type: "batch", body: body.subarray(start) };
    switch (header & 0x1f) {
      case 0x1d: yield readPush(reader, header); break;
      case 0x1e: yield readDeclaration(reader, header); break;
      case 0x19: skipInterest(reader, header); break;
      case 0x1f: skipAdministration(reader, header); break;
      // Queries: a member declares no queryable, so none follows. The rest of the body cannot be read.
      default: throw new WireError(`the network message ${header & 0x1f} is unknown`);
    }
  }
}

function readPush(reader, header) {
  const key = reader.key(header);
  reader.extensions(header);
  const body = reader.byte();
  const isPut = (body & 0x1f) === 0x01;
  if (body & 0x20) {
    reader.zint();
    reader.slice();
  }
  if (!isPut) {
    reader.extensions(body);
    return { type: "delete", key };
  }
  if (body & 0x40 && reader.zint() & 0x01) reader.slice();
  reader.extensions(body);
  return { type: "put", key, payload: reader.slice() };
}

const DECLARATIONS = {
  0x00: "key", 0x01: "forgetKey", 0x02: "subscriber", 0x03: "noSubscriber", 0x04: "queryable", 0x05: "noQueryable",
  0x06: "token", 0x07: "noToken",
};

function readDeclaration(reader, header) {
  const interest = header & 0x20 ? reader.zint() : undefined;
  reader.extensions(header);
  const head = reader.byte();
  const id = head & 0x1f;
  if (id === 0x1a) {
    reader.extensions(head);
    return { type: "final", interest };
  }
  const type = DECLARATIONS[id];
  if (type === undefined) throw new WireError(`the declaration ${id} is unknown`);
  const number = reader.zint();
  const key = id % 2 === 0 ? reader.key(head) : undefined;
  const extensions = reader.extensions(head);
  return { type, interest, number, key: key ?? keyOfUndeclared(extensions.get(0x0f)) };
}

/** An undeclaration may carry the key of what it undeclares: flags, mapping, and the suffix to the end. */
function keyOfUndeclared(body) {
  if (body === undefined) return undefined;
  const reader = new Reader(body);
  const flags = reader.byte();
  return { mapping: reader.zint(), suffix: flags & 0x01 ? utf8.decode(reader.rest()) : "" };
}

function skipInterest(reader, header) {
  reader.zint();
  if (header & 0x60) {
    const options = reader.byte();
    if (options & RESTRICTED) reader.key(options);
  }
  reader.extensions(header);
}

function skipAdministration(reader, header) {
  reader.zint();
  reader.extensions(header);
  const encoding = (header >> 5) & 0x03;
  if (encoding === 1) reader.zint();
  else if (encoding === 2) reader.slice();
}
