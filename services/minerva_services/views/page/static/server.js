/** The link to the page's own server: orders of people go out, the state of the world comes in. */

const RETRY = 1000; // milliseconds

/** The URL of a WebSocket of this page's server. */
export const socketUrl = (path) => `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`;

/**
 * Connects to the server, again and again until the world has ended.
 *
 * `on(message)` is called with each message, `onLost(reason)` when the link is gone. The result has
 * `send(message)`, which is false while there is no link.
 */
export function connectToServer(on, onLost) {
  let socket;
  let hasEnded = false;
  const open = () => {
    socket = new WebSocket(socketUrl("/people"));
    socket.addEventListener("message", ({ data }) => {
      const message = JSON.parse(data);
      hasEnded ||= message.ended !== undefined;
      on(message);
    });
    socket.addEventListener("close", async () => {
      if (hasEnded) return;
      onLost(await refusal());
      setTimeout(open, RETRY);
    });
  };
  open();
  const send = (message) => {
    const isOpen = socket.readyState === WebSocket.OPEN;
    if (isOpen) socket.send(JSON.stringify(message));
    return isOpen;
  };
  return { send };
}

/** Why the server does not admit this page; a WebSocket does not pass the reason on. */
async function refusal() {
  try {
    const answer = await fetch("/people");
    return answer.status === 403 ? (await answer.text()).trim() : "";
  } catch {
    return "";
  }
}
