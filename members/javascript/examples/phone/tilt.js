/** The tilt of a phone as events: how far its right edge and its upper edge are down, from -1 to 1. */

import { event, source } from "minerva-bus";

const EVERY = 100; // milliseconds
const LEAST = 0.1;

/** Asks for permission, where a browser wants that, and fails where there is no sensor to ask for. */
async function prepare() {
  if (globalThis.DeviceOrientationEvent === undefined) throw new Error("this browser gives no tilt; open the page by https");
  const permission = await DeviceOrientationEvent.requestPermission?.();
  if (permission === "denied") throw new Error("the tilt was not permitted");
}

function start(emit) {
  let tilt = null;
  const measure = ({ beta, gamma }) => {
    const share = (degrees) => Math.max(-1, Math.min(1, degrees / 45));
    if (beta !== null && gamma !== null) tilt = { x: share(gamma), y: share(-beta) };
  };
  const send = () => {
    if (tilt !== null && Math.hypot(tilt.x, tilt.y) > LEAST) emit(event("eTilt", tilt));
    tilt = null;
  };
  addEventListener("deviceorientation", measure);
  const timer = setInterval(send, EVERY);
  return () => {
    removeEventListener("deviceorientation", measure);
    clearInterval(timer);
  };
}

export const tilt = {
  role: source({ service: "tilt of a phone", generates: ["eTilt"], people: true, start }),
  button: "Push the snails by tilting",
  prepare,
};
