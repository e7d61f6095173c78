/** The page: it draws the world, sends orders of its user, and hosts what its world's modules define. */

import { device } from "minerva-bus";

import { Scene } from "./canvas.js";
import { displayList } from "./geometry.js";
import { Inspector } from "./inspector.js";
import { include, isPale, legend } from "./legend.js";
import { loadMember, PageMember } from "./members.js";
import { Orders } from "./orders.js";
import { Parting } from "./parting.js";
import { Person, showFates, showPeople } from "./people.js";
import { connectToServer } from "./server.js";
import { Timeline } from "./timeline.js";

const element = (id) => document.getElementById(id);
const scene = new Scene(element("scene"));
// On a phone the legend would take the picture's room.
element("explained").open = window.innerHeight > 600 && window.innerWidth > 600;
const drawn = new Map();
const explained = new Map();
const members = [];
let world = null;

const server = connectToServer(onMessage, (reason) => lose(reason || "the link to the world is lost; trying again …"));
const orders = new Orders(scene, element("orders"), (order) => server.send(order), select);
const person = new Person({ form: element("naming"), button: element("you"), input: element("name") }, (name) => server.send({ name }));
const timeline = new Timeline({ slider: element("moment"), live: element("live"), shown: element("shown"), mark: element("mark") }, {
  show: (items, frame) => {
    scene.show(items);
    element("frame").textContent = `frame ${frame}`;
    // Drawn before this call, so that what the attribute promises can be clicked.
    requestAnimationFrame(() => (document.body.dataset.frame = String(frame)));
  },
  seek: (frame) => server.send({ seek: frame }),
  pause: (frame) => server.send({ pause: frame }),
  onChange: () => inspector.refresh(),
});
const inspector = new Inspector(element("inspector"), { ask: (message) => server.send(message), past: () => timeline.past, asked: () => timeline.asked, select });
const parting = new Parting({ button: element("part"), panel: element("parting") }, {
  ask: () => server.send({ bisect: true }),
  jump: (frame) => timeline.stopAt(frame) || note(`this page no longer has frame ${frame}; replay the record to see it`, true),
  mark: (frame) => (timeline.marked = frame),
  select,
});
let own = "";
let hasEnded = false;

/** Selects an agent on the picture and in the inspector, which has the place of other panels; "" selects none. */
function select(agent) {
  if (agent !== "") parting.close();
  scene.select(agent);
  inspector.open(agent);
  if (!hasEnded) note(""); // it says to whom orders go
}

element("choose").addEventListener("change", ({ target }) => {
  select(target.value.trim().replace(/^#/, ""));
  target.value = "";
});
element("choose").addEventListener("focus", () => {
  const ids = scene.agents.map((id) => new Option(id));
  element("agents").replaceChildren(...ids);
});

/** Shows a line to the user; without any, what a tap does. */
function note(text, isError = false) {
  element("notice").textContent = text || (drawn.size > 0 ? orders.hint : "");
  element("notice").classList.toggle("error", isError);
  element("notice").dataset.isHint = String(text === "");
}

/** The link is gone, and with it the questions that the server has not answered. */
function lose(reason) {
  note(reason, true);
  inspector.fail(reason);
  parting.fail(reason);
}

function onMessage(message) {
  if (message.welcome !== undefined) begin(message.welcome);
  if (message.status !== undefined) update(message.status);
  if (message.orders !== undefined) showFates(element("fates"), message.orders);
  if (message.you !== undefined) showSelf(message.you);
  if (message.state !== undefined) inspector.take(message.state);
  if (message.explained !== undefined) inspector.explain(message.explained);
  if (message.bisected !== undefined) parting.take(message.bisected);
  if (message.note !== undefined) note(message.note);
  if (message.error !== undefined) note(message.error, true);
  if (message.ended !== undefined) end(message.ended);
}

/** The server has admitted this page; it may have done so before, if the link was lost. */
function begin(welcome) {
  if (world !== null && world.page === welcome.page) return inspector.refresh();
  if (world !== null) return location.reload();
  world = { ...welcome, taken: [] };
  showSelf(welcome.you);
  person.begin();
  parting.begin(world.beside);
  document.title = element("world").textContent = world.world;
  const view = device({ service: "page", draws: world.draws, when: `at ${world.rate} Hz`, draw });
  join(world.page, view);
  for (const [exported, name] of Object.entries(world.joins)) prepareToJoin(name, exported);
}

function end(why) {
  hasEnded = true;
  note(why);
  inspector.fail(why);
  parting.fail(why);
}

function showSelf(you) {
  own = you.name;
  person.show(you);
}

async function prepareToJoin(name, exported) {
  try {
    const { role, button, prepare } = await loadMember(world.module, exported);
    if (button === "") return join(name, role);
    const start = async (pressed) => {
      await prepare();
      pressed.remove();
      join(name, role);
    };
    orders.addButton(button, start, (error) => note(error.message, true));
  } catch (error) {
    note(`${name}: ${error.message}`, true);
  }
}

function join(name, makeRole) {
  const mayJoin = () => !world.taken.includes(name);
  members.push(new PageMember(name, makeRole, { world: world.world, mayJoin, log: report }));
  poke();
}

// A member that could not join tries again, for instance when its world is back.
setInterval(() => world !== null && poke(), 500);

function report(line) {
  console.warn(line);
  note(line, true);
}

async function poke() {
  for (const member of members) {
    member.poke().catch((error) => report(`${member.name}: ${error.message}`));
  }
  showMembers();
}

function update(status) {
  world.taken = status.taken;
  orders.update(status);
  timeline.end = status.end;
  showPeople(element("people"), status.people, own);
  const isNew = status.report !== "" && status.report !== world.report;
  world.report = status.report;
  if (isNew) note(status.report);
  else if (element("notice").dataset.isHint === "true") note("");
  poke();
}

function showMembers() {
  const texts = members.slice(1).map(({ name, state }) => {
    if (state === "here") return name;
    return `${name}: ${world.taken.includes(name) ? "on another page" : state}`;
  });
  element("members").textContent = texts.join(" · ");
}

function draw({ type, frame, nodes, vocabulary }) {
  const isFirst = drawn.size === 0;
  drawn.set(type, displayList(nodes, vocabulary, world.scales));
  if (isFirst) note("");
  const items = world.draws.flatMap((each) => drawn.get(each) ?? []);
  timeline.add(items, Number(frame));
  if (items.filter((item) => include(explained, item)).length > 0) showLegend(vocabulary);
}

function showLegend(vocabulary) {
  const entries = legend(explained, vocabulary, world.scales).map(({ text, form, colours }) => {
    const entry = document.createElement("li");
    const swatch = document.createElement("i");
    swatch.className = form === "line" && isPale(colours[0]) ? "line dark" : form;
    const stops = colours.map((colour, n) => `${colour} ${(100 * n) / colours.length}% ${(100 * (n + 1)) / colours.length}%`);
    if (form === "line") [swatch.style.borderColor] = colours;
    else swatch.style.background = `linear-gradient(90deg, ${stops.join(", ")})`;
    swatch.classList.toggle("wide", colours.length > 1);
    entry.append(swatch, text);
    return entry;
  });
  element("legend").replaceChildren(...entries);
}
