/** Links to a Zenoh router: batches of bytes over TCP (Node) or over a WebSocket (browsers, Node 22). */

const LONGEST_BATCH = 0xffff;

/**
 * Connects to an endpoint: `tcp/HOST:PORT`, `ws/HOST:PORT`, `wss/HOST:PORT`, or the URL of a WebSocket.
 *
 * `onBatch(bytes)` is called for each batch, and once when the link is gone `onClose(reason)`, whose
 * reason is "" if the other side gave none. The result has `send(batch)` and `close()`.
 */
export async function connect(endpoint, onBatch, onClose) {
  if (/^wss?:\/\//.test(endpoint)) return webSocket(endpoint, onBatch, onClose);
  const match = /^(tcp|wss?)\/(.+):(\d+)$/.exec(endpoint);
  if (match === null) throw new Error(`${endpoint} is not an endpoint such as tcp/127.0.0.1:7447 or ws/127.0.0.1:7448`);
  const [, protocol, host, port] = match;
  if (protocol === "tcp") return tcp(host, Number(port), onBatch, onClose);
  return webSocket(`${protocol}://${host}:${port}`, onBatch, onClose);
}

async function tcp(host, port, onBatch, onClose) {
  const { createConnection } = await import("node:net");
  const socket = createConnection({ host: host.replace(/^\[|\]$/g, ""), port, noDelay: true });
  await new Promise((resolve, reject) => socket.once("connect", resolve).once("error", reject));
  socket.on("error", () => {}); // "close" follows
  socket.on("close", () => onClose(""));
  socket.on("data", split(onBatch));
  const send = (batch) => {
    socket.cork();
    socket.write(Uint8Array.of(batch.length & 0xff, batch.length >> 8));
    socket.write(batch);
    socket.uncork();
  };
  return { send, close: () => socket.end() };
}

/** Collects pieces of a stream, and calls `onBatch` for each batch: its length in two bytes, then its bytes. */
function split(onBatch) {
  let pieces = [];
  let size = 0;
  let wanted = 2;
  return (piece) => {
    pieces.push(piece);
    size += piece.length;
    if (size < wanted) return;
    let data = pieces.length === 1 ? piece : Buffer.concat(pieces);
    for (;;) {
      wanted = data.length < 2 ? 2 : 2 + data.readUInt16LE(0);
      if (data.length < wanted) break;
      onBatch(new Uint8Array(data.buffer, data.byteOffset + 2, wanted - 2));
      data = data.subarray(wanted);
    }
    [pieces, size] = [[data], data.length];
  };
}

async function webSocket(url, onBatch, onClose) {
  if (globalThis.WebSocket === undefined) throw new Error(`${url} needs a browser, or Node 22 or newer`);
  const socket = new WebSocket(url);
  socket.binaryType = "arraybuffer";
  await new Promise((resolve, reject) => {
    socket.addEventListener("open", resolve, { once: true });
    socket.addEventListener("error", () => reject(new Error(`nothing answers at ${url.replace(/\?.*/, "")}`)), { once: true });
  });
  socket.addEventListener("message", ({ data }) => onBatch(new Uint8Array(data)));
  socket.addEventListener("close", ({ reason }) => onClose(reason));
  return { send: (batch) => socket.send(batch), close: () => socket.close() };
}

export { LONGEST_BATCH };
