/** The snails of phone.py in JavaScript. */

import { agent, figure, host, transformation } from "minerva-bus";

const snail = agent("ASnail", {
  fields: { x: ["real m", 0], y: ["real m", 0], water: ["real", 3], births: ["int", 0n] },
  on: {
    eRain(self, rain, moment) {
      const snail = self.values;
      snail.water += moment.random();
      if (snail.water > 5) {
        snail.water /= 2;
        return [self, self.child({ x: snail.x + 0.3, y: snail.y, water: snail.water })];
      }
    },
    eSun(self, sun, moment) {
      const snail = self.values;
      snail.x += 0.1 * (moment.random() - 0.5);
      snail.y += 0.1 * (moment.random() - 0.5);
      snail.water -= sun.values.heat;
      if (snail.water <= 0) return [];
    },
    eTilt(self, { values: tilt }) {
      self.values.x = Math.max(-3, Math.min(3, self.values.x + 0.1 * tilt.x));
      self.values.y = Math.max(-3, Math.min(3, self.values.y + 0.1 * tilt.y));
    },
    eLettuce(self, { values: lettuce }) {
      self.values.x += 0.3 * (lettuce.x - self.values.x);
      self.values.y += 0.3 * (lettuce.y - self.values.y);
      self.values.water += 0.5;
    },
  },
  views: {
    ePicture: ({ values: { x, y, water } }) =>
      [transformation("TAt", { x, y }, [figure("PShell", { size: 0.02 + 0.03 * water })])],
  },
});

export const snails = host([snail], { service: "page" });
