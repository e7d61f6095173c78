/** A Zenoh session in client mode: publish, subscribe and liveliness. */

import { connect, LONGEST_BATCH } from "./link.js";
import * as wire from "./wire.js";

// Node 18 has no global `crypto`.
const { webcrypto } = globalThis.crypto ? { webcrypto: globalThis.crypto } : await import("node:crypto");

const NOTHING = new Uint8Array(0);
const LEASE = 3; // seconds
const RETRY = { first: 50, most: 500 }; // milliseconds
const OPENING = 5000; // milliseconds

/**
 * A session with one router, which connects again when its link is lost.
 *
 * `onSample({key, payload})` gets the messages of all subscriptions in the order in which they were
 * sent, `onToken(key, isAlive)` the liveliness tokens, and `onProblem(text)`
 * what went wrong: a message that cannot be read, a link that was closed for a reason.
 */
export class Session {
  #endpoint;
  #handlers;
  #id = webcrypto.getRandomValues(new Uint8Array(16));
  #link;
  #batchSize;
  #sequence = 0;
  #timers = [];
  #declared = new Map();
  #mappings = new Map();
  #tokens = new Map();
  #answers = new Map();
  #fragments = [];
  #number = 0;
  #heardAt = 0;
  #isClosed = false;

  constructor(endpoint, handlers) {
    this.#endpoint = endpoint;
    this.#handlers = handlers;
  }

  /** Opens a session; fails if nothing answers at the endpoint within `OPENING`. */
  static async open(endpoint, { onSample = () => {}, onToken = () => {}, onProblem = () => {} } = {}) {
    const session = new Session(endpoint, { onSample, onToken, onProblem });
    await session.#connect();
    return session;
  }

  // --- what a member does ---

  put(key, payload) {
    this.#send(wire.put(key, payload));
  }

  subscribe(key) {
    this.#declare(wire.declareSubscriber(this.#nextNumber(), key));
  }

  /** Watches the tokens of a key, those that exist included. */
  watch(key) {
    this.#declare(wire.interestInTokens(this.#nextNumber(), key, true));
  }

  /** Declares a token; returns the function that undeclares it. */
  declareToken(key) {
    const number = this.#nextNumber();
    const message = wire.declareToken(number, key);
    this.#declare(message);
    return () => {
      this.#declared.delete(message);
      this.#send(wire.undeclareToken(number));
    };
  }

  /** The keys of the tokens that exist. */
  async tokens(key) {
    const number = this.#nextNumber();
    const keys = [];
    await new Promise((resolve) => {
      this.#answers.set(number, { keys, resolve });
      this.#send(wire.interestInTokens(number, key, false));
    });
    return keys;
  }

  close() {
    this.#isClosed = true;
    this.#timers.forEach(clearInterval);
    this.#link?.send(wire.close());
    this.#link?.close();
    this.#link = undefined;
  }

  // --- the link ---

  async #connect() {
    const expected = ["init", "open"];
    const answers = {};
    const answered = (type) => new Promise((resolve, reject) => (answers[type] = { resolve, reject }));
    const fail = (error) => Object.values(answers).forEach(({ reject }) => reject(error));
    const onBatch = (bytes) => {
      // Other messages may follow the answer to OPEN at once.
      if (expected.length === 0) return this.#receive(bytes);
      try {
        const answer = wire.readBatch(bytes);
        const type = expected.shift();
        if (answer.type !== type) throw new Error(`${this.#endpoint} refused the session`);
        if (type === "open") this.#begin(link, batchSize, answer.lease);
        answers[type].resolve(answer);
      } catch (error) {
        fail(error);
      }
    };
    const onClose = (reason) => {
      fail(new Error(reason || `${this.#endpoint} closed the link`));
      if (reason && this.#link === link) this.#handlers.onProblem(`the link was closed: ${reason}`);
      this.#lose(link);
    };
    let batchSize;
    const [init, open] = [answered("init"), answered("open")];
    for (const answer of [init, open]) answer.catch(() => {});
    const link = await connect(this.#endpoint, onBatch, onClose);
    const timeout = setTimeout(() => fail(new Error(`${this.#endpoint} does not answer as a Zenoh router`)), OPENING);
    try {
      link.send(wire.init(this.#id, LONGEST_BATCH));
      const answer = await init;
      batchSize = answer.batchSize;
      link.send(wire.open(LEASE, this.#sequence, answer.cookie));
      await open;
    } catch (error) {
      link.close();
      throw error;
    } finally {
      clearTimeout(timeout);
    }
  }

  #begin(link, batchSize, lease) {
    this.#link = link;
    this.#batchSize = Math.min(batchSize, LONGEST_BATCH);
    this.#heardAt = performance.now();
    const silent = () => performance.now() - this.#heardAt > lease && this.#lose(link);
    this.#timers = [
      setInterval(() => link.send(wire.keepAlive()), (LEASE * 1000) / 4),
      setInterval(silent, lease / 4),
    ];
    for (const message of this.#declared.keys()) this.#send(message);
  }

  #lose(link) {
    if (link === undefined || this.#link !== link) return;
    this.#timers.forEach(clearInterval);
    this.#link = undefined;
    this.#mappings.clear();
    this.#fragments = [];
    link.close();
    for (const { resolve } of this.#answers.values()) resolve();
    this.#answers.clear();
    const gone = [...this.#tokens.values()];
    this.#tokens.clear();
    for (const key of gone) this.#handlers.onToken(key, false);
    this.#reconnect();
  }

  async #reconnect() {
    for (let wait = RETRY.first; !this.#isClosed; wait = Math.min(1.5 * wait, RETRY.most)) {
      await new Promise((resolve) => this.#timers.push(setTimeout(resolve, wait)));
      try {
        if (!this.#isClosed) return await this.#connect();
      } catch {
        // Nothing answers yet.
      }
    }
  }

  /** Sends a message, or drops it while there is no link. */
  #send(message) {
    if (this.#link === undefined) return;
    const batches = wire.batches(message, this.#sequence, this.#batchSize);
    this.#sequence = wire.after(this.#sequence, batches.length);
    for (const batch of batches) this.#link.send(batch);
  }

  #declare(message) {
    this.#declared.set(message, true);
    this.#send(message);
  }

  #nextNumber() {
    this.#number += 1;
    return this.#number;
  }

  // --- what the router sends ---

  #receive(bytes) {
    this.#heardAt = performance.now();
    try {
      for (let rest = bytes; rest.length > 0; ) rest = this.#receiveBatch(rest);
    } catch (error) {
      if (!(error instanceof wire.WireError)) throw error;
      this.#handlers.onProblem(`dropped a message of the bus: ${error.message}`);
    }
  }

  /** Returns what follows the first transport message of a batch. */
  #receiveBatch(bytes) {
    const batch = wire.readBatch(bytes);
    if (batch.type === "close") this.#lose(this.#link);
    if (batch.type === "keepAlive") return batch.body;
    if (batch.type === "frame") return this.#receiveMessages(batch.body);
    if (batch.type === "fragment") {
      this.#fragments.push(batch.body.slice());
      if (!batch.more) {
        const pieces = this.#fragments;
        this.#fragments = [];
        this.#receiveMessages(joinedPieces(pieces));
      }
    }
    return NOTHING;
  }

  #receiveMessages(body) {
    for (const message of wire.readMessages(body)) {
      if (message.type === "batch") return message.body;
      this.#receiveMessage(message);
    }
    return NOTHING;
  }

  #receiveMessage({ type, key, payload, number, interest }) {
    if (type === "put") this.#handlers.onSample({ key: this.#named(key), payload: payload.slice() });
    else if (type === "key") this.#mappings.set(number, this.#named(key));
    else if (type === "forgetKey") this.#mappings.delete(number);
    else if (type === "token") this.#receiveToken(interest, number, this.#named(key));
    else if (type === "noToken") this.#receiveNoToken(number, key && this.#named(key));
    else if (type === "final") this.#receiveFinal(interest);
  }

  #named({ mapping, suffix }) {
    if (mapping === 0) return suffix;
    if (!this.#mappings.has(mapping)) throw new wire.WireError("a key that was not declared");
    return this.#mappings.get(mapping) + suffix;
  }

  #receiveToken(interest, number, key) {
    const answer = this.#answers.get(interest);
    if (answer !== undefined) return answer.keys.push(key);
    this.#tokens.set(number, key);
    this.#handlers.onToken(key, true);
  }

  #receiveNoToken(number, key) {
    const known = this.#tokens.get(number) ?? key;
    this.#tokens.delete(number);
    if (known !== undefined) this.#handlers.onToken(known, false);
  }

  #receiveFinal(interest) {
    this.#answers.get(interest)?.resolve();
    this.#answers.delete(interest);
  }
}

function joinedPieces(pieces) {
  const result = new Uint8Array(pieces.reduce((size, piece) => size + piece.length, 0));
  let at = 0;
  for (const piece of pieces) {
    result.set(piece, at);
    at += piece.length;
  }
  return result;
}
