/** People: the name and colour of this page's person, those of others, and the fates of orders. */

const KEPT = "minerva-name";
const LONG = 44;

function dot(colour) {
  const mark = document.createElement("i");
  mark.className = "person";
  mark.style.backgroundColor = colour;
  return mark;
}

/**
 * The person of this page.
 *
 * `choose(name)` asks the server for a name; it answers with `show`, or refuses.
 */
export class Person {
  #parts;
  #choose;

  constructor(parts, choose) {
    this.#parts = parts;
    this.#choose = choose;
    parts.button.addEventListener("click", () => this.#edit(true));
    parts.input.addEventListener("blur", () => this.#edit(false));
    parts.input.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Escape") this.#edit(false);
    });
    parts.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.#choose(parts.input.value.trim());
      this.#edit(false);
    });
  }

  /** Asks for the name of the last visit. */
  begin() {
    const kept = localStorage.getItem(KEPT);
    if (kept) this.#choose(kept);
  }

  show({ name, colour }) {
    const { button, input } = this.#parts;
    button.replaceChildren(dot(colour), name);
    input.value = name;
    if (/^page-\d+$/.test(name)) localStorage.removeItem(KEPT);
    else localStorage.setItem(KEPT, name);
  }

  #edit(isOpen) {
    const { button, input } = this.#parts;
    [button.hidden, input.hidden] = [isOpen, !isOpen];
    if (isOpen) {
      input.focus();
      input.select();
    }
  }
}

/** Shows the people at other pages. */
export function showPeople(place, people, own) {
  const others = people.filter(({ name }) => name !== own);
  place.replaceChildren(...others.map(({ name, colour }) => {
    const chip = document.createElement("span");
    chip.append(dot(colour), name);
    return chip;
  }));
}

/** Lists the last orders with their fates, newest first. */
export function showFates(place, orders) {
  place.replaceChildren(...orders.toReversed().map(({ person, colour, event, state, fate }) => {
    const entry = document.createElement("li");
    const [name, text] = [document.createElement("b"), document.createElement("span")];
    name.style.color = colour;
    name.textContent = person;
    text.className = `fate ${state}`;
    text.textContent = fate;
    entry.title = `${event} of ${person}: ${fate}`;
    entry.append(dot(colour), name, ` ${event.length > LONG ? `${event.slice(0, LONG - 1)}…` : event} `, text);
    return entry;
  }));
}
