/** Draws the garden as SVG: an observer. The file is the first argument, or garden.svg. */

import { writeFileSync } from "node:fs";

import { device, run } from "../src/index.js";

const file = process.argv[2] ?? "garden.svg";
let shells = 0n;

function draw({ frame, nodes }) {
  const discs = nodes.map(({ values }, n) => `<circle cx="${20 + 30 * n}" cy="40" r="${2 * values.size}" fill="#886644"/>`);
  const size = `viewBox="0 0 ${10 + 30 * Math.max(nodes.length, 5)} 60"`;
  const title = `<text x="5" y="12" font-size="10" font-family="sans-serif">frame ${frame}: ${nodes.length} snails</text>`;
  writeFileSync(file, `<svg xmlns="http://www.w3.org/2000/svg" ${size}>${title}${discs.join("")}</svg>\n`);
  shells = BigInt(nodes.length);
}

await run(device({ draws: ["eShow"], when: "each 10 frames", draw, report: () => ({ shells }) }));
