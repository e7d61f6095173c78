/**
 * MessagePack without loss: an integer is a BigInt, a real is a number, a map is a Map with text as
 * keys, binary is a Uint8Array, and an extension is an `Extension`.
 */

const MAX_DEPTH = 512;
const utf8 = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true });
const encoder = new TextEncoder();

/** Data that cannot be read, or a value that cannot be written. */
export class Invalid extends Error {}

/** An extension type: a number from -128 to 127 and its bytes. */
export class Extension {
  constructor(type, data) {
    this.type = type;
    this.data = data;
  }
}

/** The values that follow one another in `bytes`, exactly `count` of them. */
export function decodeAll(bytes, count) {
  const reader = new Reader(bytes);
  const values = Array.from({ length: count }, () => reader.value(0));
  if (reader.at !== bytes.length) throw new Invalid("data after the end");
  return values;
}

export function decode(bytes) {
  return decodeAll(bytes, 1)[0];
}

class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
  }

  take(length) {
    if (length > this.bytes.length - this.at) throw new Invalid("cut off");
    this.at += length;
    return this.at - length;
  }

  size(width) {
    const at = this.take(width);
    return width === 1 ? this.view.getUint8(at) : width === 2 ? this.view.getUint16(at) : this.view.getUint32(at);
  }

  data(length) {
    const at = this.take(length);
    return this.bytes.slice(at, at + length);
  }

  text(length) {
    const at = this.take(length);
    try {
      return utf8.decode(this.bytes.subarray(at, at + length));
    } catch {
      throw new Invalid("text that is not UTF-8");
    }
  }

  list(length, depth) {
    // A length that the rest cannot hold is refused before anything is allocated.
    if (length > this.bytes.length - this.at) throw new Invalid("cut off");
    const items = [];
    while (items.length < length) items.push(this.value(depth));
    return items;
  }

  map(length, depth) {
    const result = new Map();
    for (let n = 0; n < length; n++) {
      const key = this.value(depth);
      if (typeof key !== "string") throw new Invalid("a key that is not text");
      result.set(key, this.value(depth));
    }
    return result;
  }

  extension(length) {
    const type = this.view.getInt8(this.take(1));
    return new Extension(type, this.data(length));
  }

  value(depth) {
    if (depth > MAX_DEPTH) throw new Invalid("nested too deeply");
    const head = this.size(1);
    if (head < 0x80) return BigInt(head);
    if (head >= 0xe0) return BigInt(head - 0x100);
    if (head < 0x90) return this.map(head & 0x0f, depth + 1);
    if (head < 0xa0) return this.list(head & 0x0f, depth + 1);
    if (head < 0xc0) return this.text(head & 0x1f);
    return this.headed(head, depth);
  }

  headed(head, depth) {
    const { view } = this;
    switch (head) {
      case 0xc0: return null;
      case 0xc2: return false;
      case 0xc3: return true;
      case 0xc4: case 0xc5: case 0xc6: return this.data(this.size(1 << (head - 0xc4)));
      case 0xc7: case 0xc8: case 0xc9: return this.extension(this.size(1 << (head - 0xc7)));
      case 0xca: return view.getFloat32(this.take(4));
      case 0xcb: return view.getFloat64(this.take(8));
      case 0xcc: case 0xcd: case 0xce: return BigInt(this.size(1 << (head - 0xcc)));
      case 0xcf: return view.getBigUint64(this.take(8));
      case 0xd0: return BigInt(view.getInt8(this.take(1)));
      case 0xd1: return BigInt(view.getInt16(this.take(2)));
      case 0xd2: return BigInt(view.getInt32(this.take(4)));
      case 0xd3: return view.getBigInt64(this.take(8));
      case 0xd4: case 0xd5: case 0xd6: case 0xd7: case 0xd8: return this.extension(1 << (head - 0xd4));
      case 0xd9: case 0xda: case 0xdb: return this.text(this.size(1 << (head - 0xd9)));
      case 0xdc: case 0xdd: return this.list(this.size(2 << (head - 0xdc)), depth + 1);
      case 0xde: case 0xdf: return this.map(this.size(2 << (head - 0xde)), depth + 1);
      default: throw new Invalid("a reserved byte");
    }
  }
}

/** The shortest MessagePack of values, one after another. Plain objects are maps too. */
export function encode(...values) {
  const writer = new Writer();
  for (const value of values) writer.value(value);
  return writer.bytes.slice(0, writer.at);
}

class Writer {
  constructor() {
    this.bytes = new Uint8Array(256);
    this.view = new DataView(this.bytes.buffer);
    this.at = 0;
  }

  room(length) {
    if (this.at + length > this.bytes.length) {
      const larger = new Uint8Array(Math.max(this.bytes.length * 2, this.at + length));
      larger.set(this.bytes);
      this.bytes = larger;
      this.view = new DataView(larger.buffer);
    }
    this.at += length;
    return this.at - length;
  }

  byte(value) {
    const at = this.room(1);
    this.view.setUint8(at, value);
  }

  data(bytes) {
    const at = this.room(bytes.length);
    this.bytes.set(bytes, at);
  }

  /** A length, after the first of `heads` that is wide enough: for 1, 2 and 4 bytes, or undefined. */
  head(length, heads) {
    const place = length < 0x100 && heads[0] !== undefined ? 0 : length < 0x10000 ? 1 : 2;
    this.byte(heads[place]);
    const width = 1 << place;
    const at = this.room(width);
    if (width === 1) this.view.setUint8(at, length);
    else if (width === 2) this.view.setUint16(at, length);
    else this.view.setUint32(at, length);
  }

  integer(value) {
    if (value < -(2n ** 63n) || value >= 2n ** 64n) throw new Invalid(`${value} has more than 64 bits`);
    if (value >= -32n && value < 128n) return this.byte(Number(BigInt.asUintN(8, value)));
    if (value >= 2n ** 32n) return this.wide(0xcf, value);
    if (value >= 0n) return this.head(Number(value), [0xcc, 0xcd, 0xce]);
    if (value < -(2n ** 31n)) return this.wide(0xd3, BigInt.asUintN(64, value));
    const width = value >= -(2n ** 7n) ? 1 : value >= -(2n ** 15n) ? 2 : 4;
    this.byte({ 1: 0xd0, 2: 0xd1, 4: 0xd2 }[width]);
    const at = this.room(width);
    if (width === 1) this.view.setInt8(at, Number(value));
    else if (width === 2) this.view.setInt16(at, Number(value));
    else this.view.setInt32(at, Number(value));
  }

  wide(head, value) {
    this.byte(head);
    const at = this.room(8);
    this.view.setBigUint64(at, value);
  }

  text(value) {
    const bytes = encoder.encode(value);
    if (bytes.length < 32) this.byte(0xa0 | bytes.length);
    else this.head(bytes.length, [0xd9, 0xda, 0xdb]);
    this.data(bytes);
  }

  map(entries) {
    if (entries.length < 16) this.byte(0x80 | entries.length);
    else this.head(entries.length, [undefined, 0xde, 0xdf]);
    for (const [key, value] of entries) {
      this.text(key);
      this.value(value);
    }
  }

  extension({ type, data }) {
    const fixed = [1, 2, 4, 8, 16].indexOf(data.length);
    if (fixed >= 0) this.byte(0xd4 + fixed);
    else this.head(data.length, [0xc7, 0xc8, 0xc9]);
    this.byte(type & 0xff);
    this.data(data);
  }

  value(value) {
    if (value === null) this.byte(0xc0);
    else if (typeof value === "boolean") this.byte(value ? 0xc3 : 0xc2);
    else if (typeof value === "bigint") this.integer(value);
    else if (typeof value === "number") {
      this.byte(0xcb);
      const at = this.room(8);
      this.view.setFloat64(at, value);
    } else if (typeof value === "string") this.text(value);
    else if (Array.isArray(value)) {
      if (value.length < 16) this.byte(0x90 | value.length);
      else this.head(value.length, [undefined, 0xdc, 0xdd]);
      for (const item of value) this.value(item);
    } else if (value instanceof Uint8Array) {
      this.head(value.length, [0xc4, 0xc5, 0xc6]);
      this.data(value);
    } else if (value instanceof Extension) this.extension(value);
    else if (value instanceof Map) this.map([...value]);
    else if (typeof value === "object") this.map(Object.entries(value));
    else throw new Invalid(`a ${typeof value} cannot be sent`);
  }
}
