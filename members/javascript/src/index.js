/** A member of a Minerva Bus world. */

export { device } from "./device.js";
export { generator } from "./generator.js";
export { digest } from "./digest.js";
export { agent, host } from "./host.js";
export { run } from "./run.js";
export { event, figure, transformation, unpacked } from "./scene.js";
export { source } from "./source.js";
