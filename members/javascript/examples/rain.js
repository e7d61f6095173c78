/** Rain in every second frame: a generator that counts its showers, also across a restart. */

import { event, generator, run } from "../src/index.js";

await run(
  generator({
    generates: ["eRain"],
    state: { showers: 0n },
    tick({ frame, state }) {
      if (frame % 2n !== 0n) return [];
      state.showers += 1n;
      return [event("eRain")];
    },
    report: ({ showers }) => ({ showers }),
  }),
);
