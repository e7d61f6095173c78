/** The slider over the recent past of a world, or over the record that is replayed. */

const MOST_MOMENTS = 600;
const THUMB = 16; // pixels
const MOST_VALUES = 4e6; // items and cells of matrices, each counted once

/**
 * Keeps what was drawn in the last frames, in bounded memory, and shows one of them.
 *
 * `show(items, frame)` draws; `seek(frame)` moves a replay, and `pause(frame)` pauses it there. If
 * the memory is full, every second moment of the older half is dropped: the past remains, but in
 * larger steps.
 */
export class Timeline {
  #parts;
  #show;
  #seek;
  #pause;
  #moments = [];
  #chosen = null; // a frame of the past; null: live
  #end = 0;
  #marked = null;
  #onChange;

  constructor(parts, { show, seek, pause, onChange }) {
    this.#parts = parts;
    this.#show = show;
    this.#seek = seek;
    this.#pause = pause;
    this.#onChange = onChange;
    parts.slider.addEventListener("input", () => this.#choose(Number(parts.slider.value)));
    parts.live.addEventListener("click", () => this.goLive());
    parts.mark.addEventListener("click", () => this.stopAt(this.#marked));
    this.#update();
  }

  /** The frame of the past that is shown; null if the page is live. */
  get past() {
    return this.#chosen;
  }

  /** The frame that questions are about: that which is shown, or null for the latest one. */
  get asked() {
    return this.#end > 0 ? (this.#moments.at(-1)?.frame ?? null) : this.#chosen;
  }

  /** Takes what was drawn for a frame; shows it if the page is live. */
  add(items, frame) {
    const last = this.#moments.at(-1);
    // A replay that went back shows frames that are not the future of the earlier ones.
    if (last !== undefined && frame < last.frame) this.#moments = [];
    if (this.#moments.at(-1)?.frame === frame) this.#moments.pop();
    this.#moments.push({ frame, items });
    this.#forget();
    if (this.#chosen === null) this.#show(items, frame);
    this.#update();
  }

  /** The frame at which a replayed record ends; 0: the world is no replay. */
  set end(frame) {
    if (frame === this.#end) return;
    this.#end = frame;
    this.#update();
  }

  /** Marks a frame on the slider; null: none. */
  set marked(frame) {
    this.#marked = frame;
    this.#update();
  }

  /** Shows a frame until the user moves on; false if it is not kept. */
  stopAt(frame) {
    if (this.#end > 0) this.#pause(frame);
    else if (!this.#reaches(frame)) return false;
    else this.#choose(frame);
    return true;
  }

  goLive() {
    this.#chosen = null;
    const last = this.#moments.at(-1);
    if (last !== undefined) this.#show(last.items, last.frame);
    this.#update();
    this.#onChange();
  }

  #reaches(frame) {
    const { min, max } = this.#parts.slider;
    return frame !== null && Number(min) <= frame && frame <= Number(max);
  }

  #choose(frame) {
    if (this.#end > 0) return this.#seek(frame);
    const moment = this.#moments.findLast((each) => each.frame <= frame) ?? this.#moments[0];
    if (moment === undefined) return;
    if (moment === this.#moments.at(-1)) return this.goLive();
    this.#chosen = moment.frame;
    this.#show(moment.items, moment.frame);
    this.#update();
    this.#onChange();
  }

  #update() {
    const { slider, live, shown, mark } = this.#parts;
    const [first, last] = [this.#moments[0]?.frame ?? 0, this.#moments.at(-1)?.frame ?? 0];
    const isReplay = this.#end > 0;
    live.hidden = isReplay;
    live.classList.toggle("on", this.#chosen === null);
    live.setAttribute("aria-pressed", String(this.#chosen === null));
    [slider.min, slider.max] = isReplay ? [0, this.#end] : [first, last];
    slider.disabled = !isReplay && first === last;
    slider.value = this.#chosen ?? last;
    if (isReplay) shown.textContent = `frame ${last} of ${this.#end}`;
    else shown.textContent = this.#chosen === null ? "" : `frame ${this.#chosen}, ${last - this.#chosen} ago`;
    mark.hidden = !this.#reaches(this.#marked);
    mark.title = `Frame ${this.#marked}: here the runs part`;
    // The middle of the slider's thumb does not reach the ends of the track.
    const part = (this.#marked - slider.min) / (slider.max - slider.min || 1);
    mark.style.left = `calc(${100 * part}% + ${THUMB * (0.5 - part)}px)`;
    document.body.classList.toggle("past", this.#chosen !== null);
  }

  #forget() {
    while (this.#moments.length > MOST_MOMENTS || this.#values() > MOST_VALUES) {
      const half = Math.floor(this.#moments.length / 2);
      if (half < 2) return;
      this.#moments = this.#moments.filter(({ frame }, place) => place >= half || place % 2 === 0 || frame === this.#chosen);
    }
  }

  #values() {
    const matrices = new Set();
    let values = 0;
    for (const { items } of this.#moments) {
      values += items.length;
      for (const { matrix } of items) {
        if (matrix === undefined || matrices.has(matrix)) continue;
        matrices.add(matrix);
        values += matrix.values.length;
      }
    }
    return values;
  }
}
