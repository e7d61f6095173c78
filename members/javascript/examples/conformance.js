/** The member of the conformance suite, in the role of MINERVA_ROLE (docs/howto/other-languages.md). */

import { agent, device, event, figure, generator, host, run } from "../src/index.js";

const counter = generator({
  generates: ["eAdd"],
  orders: ["eAdd"],
  topics: ["sight"],
  publishes: ["echo"],
  state: { count: 0n },
  tick({ frame, state, orders, readings, publish }) {
    const count = Number(state.count);
    publish("echo", { type: "battery", robot: "r1", time: Number(frame), charge: 1, volts: count });
    state.count += 1n;
    const distances = readings.flatMap(({ seen }) => seen.map(([, distance]) => Number(distance)));
    const add = (amount) => event("eAdd", { amount });
    return [add(count + 0.5), ...orders, ...distances.map(add)];
  },
  report: ({ count }) => ({ ticks: count }),
});

const counters = host([
  agent("ACounter", {
    fields: { total: ["real m", 0], name: ["text", ""], births: ["int", 0n] },
    on: {
      eAdd(self, { values }) {
        self.values.total += values.amount;
      },
      eCall(self, { values: { amount } }, { emit }) {
        emit(event("eAdd", { amount }));
        emit(event("eAdd", { amount: amount / 2 }, { to: [self.id] }));
      },
      eDraw(self, _, { random }) {
        self.values.total = random();
      },
      eEnd: () => [],
      eMaybe: {
        probability: 0.5,
        act(self) {
          self.values.total += 1;
        },
      },
      eName(self, { values }) {
        self.values.name = values.name;
      },
      eSplit: (self, { values }) => [self, self.child({ total: values.amount })],
    },
    views: { eShow: ({ values }) => [figure("PBar", { length: values.total })] },
  }),
]);

function bars(options) {
  let drawn = {};
  let views = 0n;
  return device({
    draws: ["eShow"],
    when: "each frame",
    ...options,
    draw({ frame, nodes }) {
      views += 1n;
      // A sum of no reals is the integer 0, as in Python.
      const length = nodes.length === 0 ? 0n : nodes.reduce((sum, { values }) => sum + values.length, 0);
      drawn = { bars: BigInt(nodes.length), length, frame };
    },
    report: () => (options.coupled ? { ...drawn, views } : drawn),
  });
}

const roles = { generator: counter, host: counters, observer: bars({}), coupled: bars({ coupled: true }) };

await run(roles[process.env.MINERVA_ROLE ?? "generator"]);
