/** What a page is in the garden: the host of its snails, and a sensor for the tilt of a phone. */

import { tilt } from "./tilt.js";
import { snails } from "./snails.js";

export default { snails, "tilt-*": tilt };
