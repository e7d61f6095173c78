/** The sun shines in every frame: a generator without state. */

import { event, generator, run } from "../src/index.js";

await run(generator({ generates: ["eSun"], tick: () => [event("eSun", { heat: 0.2 })] }));
