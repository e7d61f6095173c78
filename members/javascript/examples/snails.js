/** The snails of the garden: a host of agents. */

import { agent, figure, host, run } from "../src/index.js";

const snail = agent("ASnail", {
  fields: { water: ["real", 3], births: ["int", 0n] },
  on: {
    eRain(self, rain, moment) {
      self.values.water += moment.random();
      if (self.values.water > 5) {
        self.values.water /= 2;
        return [self, self.child({ water: self.values.water })];
      }
    },
    eSun(self, sun) {
      self.values.water -= sun.values.heat;
      if (self.values.water <= 0) return [];
    },
  },
  views: { eShow: (self) => [figure("PShell", { size: self.values.water })] },
});

await run(host([snail]));
