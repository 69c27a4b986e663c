// The clock axis, the times of the map without quiet ones: it selects what is shown. And what changed from one moment to the shown one.
import { byId, element, folded, linkButton, named, status } from "/files/page-elements.js";
import { read } from "/files/server.js";

const SVG = "http://www.w3.org/2000/svg";
const STEPS = 10000; // of the range input; the last one is now
const FRAMES = 120; // from the first moment to the last when playing
const BREAK = 0.015; // of the axis, for a quiet time
const RENEWAL = 5000; // [ms] between two requests for the marks
const SPAN = 1000; // [ms] of a span with a single moment

/** [ms] from one label of the axis to the next: the least of them that has room is taken. */
const TICKS = [1, 5, 15, 60, 300, 900, 3600, 10800, 21600, 86400, 604800, 2592000].map((seconds) => 1000 * seconds);
const ROOM = 84, LETTER = 6.2; // [px] from one label to the next, and of a letter
const NEAR = 5; // [px] from the pointer to the mark that is told
const TITLES = { appeared: "Appeared", gone: "Gone", moved: "Moved", relabelled: "Other names", reshaped: "Other shape" };
const SIGNS = { appeared: "+", gone: "×", moved: "→" }; // on the map
const MAX_ENTRIES = 100; // of each kind

/** A time as people write it: that of the day that is `known` (today) without its date, this year's without the year.
 * @param {string | number} time
 * @param {Intl.DateTimeFormatOptions} [parts] */
export function clock(time, parts = { hour: "numeric", minute: "2-digit", second: "2-digit" }, known = new Date().toDateString()) {
  const date = new Date(time), now = new Date();
  /** @type {Intl.DateTimeFormatOptions} */
  const day = date.toDateString() === known ? {} : { month: "short", day: "numeric" };
  if (day.day && date.getFullYear() !== now.getFullYear()) day.year = "numeric";
  return new Intl.DateTimeFormat("en", { ...day, ...parts, hourCycle: "h23" }).format(date);
}

/** A time with its day, which may be today. */
export const dayAndTime = (time) => clock(time).replace(/^\d\d:/, "today, $&");

export class TimeAxis {
  /** `shown()` is called after another moment is shown. */
  constructor(data, shown) {
    this._data = data;
    this._shown = shown;
    this._input = byId("time");
    this._line = null; // the answer of `/timeline`
    /** @type {{start: number, end: number, from: number, to: number}[]} */
    this._parts = []; // spans: beginning and end [ms], and on the axis [0..1]
    /** @type {string | null | undefined} */
    this._wanted = undefined; // the moment to show next: ISO 8601, or null for now
    this._target = null; // number of the transaction that a step leads to
    this._timer = null;
    this._asked = -Infinity; // [ms]
    this._isHeld = false; // whether somebody drags on it: then it keeps its marks
    this._input.max = STEPS;
    this._input.addEventListener("input", () => this.show(this._timeAt(Number(this._input.value))));
    this._input.addEventListener("pointerdown", () => { this._isHeld = true; });
    window.addEventListener("pointerup", () => { this._isHeld = false; });
    this._input.addEventListener("pointermove", ({ clientX }) => this._point(clientX));
    this._input.addEventListener("pointerleave", () => { byId("pointed").textContent = ""; });
    byId("play").addEventListener("click", () => (this._timer ? this._stop() : this._play()));
    byId("earlier").addEventListener("click", () => this._step(-1));
    byId("later").addEventListener("click", () => this._step(1));
    byId("now").addEventListener("click", () => { this._input.focus(); this.show(null); });
    new ResizeObserver(() => this._draw()).observe(byId("marks"));
    data.addEventListener("changed", () => this._label());
  }

  /** Read the marks, at most every few seconds. */
  async follow() {
    if (this._waiting) return;
    this._waiting = true;
    do await new Promise((done) => setTimeout(done, Math.max(this._asked + RENEWAL - performance.now(), 0)));
    while (this._isHeld && (this._asked = performance.now()));
    this._asked = performance.now();
    this._waiting = false;
    try {
      this._line = await read("/timeline");
      this._lay();
      this._draw();
    } catch (error) {
      this._line = null;
      byId("past").title = `no past: ${error.message}`; // a map without a history
    }
    byId("past").classList.toggle("empty-past", !this._line);
    for (const one of [this._input, byId("play"), byId("earlier"), byId("later"), byId("compare")]) one.disabled = !this._line;
    this._label();
  }

  /** Show a moment (ISO 8601 or a number), or now (null). One state is read at a time: the last one that was wanted. */
  async show(at) {
    this._wanted = at;
    byId("past").setAttribute("aria-busy", "true");
    if (this._busy) return this._busy;
    this._busy = this._showWanted();
    await this._busy;
    this._busy = this._target = null;
    byId("past").removeAttribute("aria-busy");
    this._label();
    return undefined;
  }

  async _showWanted() {
    while (this._wanted !== undefined) {
      const at = this._wanted;
      this._wanted = undefined;
      try {
        if (await this._data.load(at)) this._shown();
        status("");
      } catch (error) {
        status(`${at === null ? "the present" : at} cannot be shown: ${error.message}`);
      }
    }
  }

  /** Name the state that is drawn, and no other. */
  _label() {
    const { time, past, last } = this._data;
    byId("moment").textContent = past === null ? "now" : clock(time);
    byId("past").classList.toggle("is-past", past !== null);
    byId("moment").title = past === null ? "" : `${time}, after transaction ${past} of ${last}`;
    this._input.setAttribute("aria-valuetext", byId("moment").textContent);
    byId("now").disabled = past === null;
    if (!this._busy) this._input.value = past === null ? STEPS : this._placeOf(Date.parse(time)) * STEPS;
  }

  /** Lay the spans side by side, in proportion to their length. */
  _lay() {
    const spans = this._line.spans.map(([start, end]) => [Date.parse(start), Math.max(Date.parse(end), Date.parse(start) + SPAN)]);
    const gap = spans.length > 1 ? Math.min(BREAK, 0.3 / spans.length) : 0;
    const total = spans.reduce((sum, [start, end]) => sum + end - start, 0);
    const least = Math.min(0.04, 0.5 / spans.length), free = 1 - gap * (spans.length - 1) - least * spans.length;
    let at = 0;
    this._parts = spans.map(([start, end]) => {
      const width = least + free * (end - start) / total, part = { start, end, from: at, to: at + width };
      at += width + gap;
      return part;
    });
  }

  _placeOf(time) {
    const part = this._parts.find((one) => time <= one.end) || this._parts.at(-1);
    if (!part) return 0;
    return part.from + Math.min(Math.max((time - part.start) / (part.end - part.start), 0), 1) * (part.to - part.from);
  }

  /** The moment at a step of the range input; null for now. */
  _timeAt(step) {
    const at = step / STEPS, part = this._parts.find((one) => at <= one.to) || this._parts.at(-1);
    if (step >= STEPS || !part) return null;
    const share = Math.max((at - part.from) / (part.to - part.from), 0);
    return new Date(part.start + share * (part.end - part.start)).toISOString();
  }

  _draw() {
    const svg = byId("marks"), width = svg.clientWidth;
    if (!this._line || !width) return;
    svg.setAttribute("viewBox", `0 0 ${width} 44`);
    const parts = this._parts.map((one) => drawn("rect", { x: one.from * width, y: 19, width: (one.to - one.from) * width, height: 4, rx: 2, class: "span" }));
    const marks = this._line.marks.map((mark) => this._mark(mark, width));
    svg.replaceChildren(...parts, ...marks, ...this._times(width));
  }

  _mark(mark, width) {
    const x = this._placeOf(Date.parse(mark.time)) * width, height = Math.min(4 + 3 * Math.log2(1 + mark.objects), 15);
    return mark.edits ? drawn("circle", { cx: x, cy: 10, r: 3.5, class: "edit" }) : drawn("rect", { x: x - 1, y: 18 - height, width: 2, height, rx: 1 });
  }

  /** Tell the time under the pointer, and what the nearest mark is for. */
  _point(clientX) {
    const { left, width } = byId("marks").getBoundingClientRect(), at = Math.min(Math.max((clientX - left) / width, 0), 1);
    if (!this._line) return;
    const time = this._timeAt(at * STEPS), far = (mark) => Math.abs(this._placeOf(Date.parse(mark.time)) - at) * width;
    const [near] = this._line.marks.filter((mark) => far(mark) < NEAR).sort((a, b) => far(a) - far(b));
    const told = near ? [near.objects && `${near.objects} came or went`, near.edits && (near.edits === 1 ? "an edit" : `${near.edits} edits`)].filter(Boolean) : [];
    byId("pointed").textContent = [time === null && !near ? "now" : clock(near?.time ?? time), ...told].join(", ");
    byId("pointed").style.left = `${100 * at}%`;
  }

  /** Clock times, where there is room: of the beginnings of spans, and round ones. */
  _times(width) {
    let free = 0, day = new Date().toDateString();
    const made = [];
    for (const { start, end, from, to } of this._parts) {
      const scale = (to - from) * width / (end - start), tick = TICKS.find((one) => one * scale >= ROOM) ?? Infinity, zone = 60000 * new Date(start).getTimezoneOffset();
      for (let time = start; time <= end; time = (Math.floor((time - zone) / tick) + 1) * tick + zone) {
        const x = (from * width) + (time - start) * scale;
        /** @type {Intl.DateTimeFormatOptions} */
        const parts = { hour: "numeric", minute: "2-digit", ...(tick < 60000 ? { second: "2-digit" } : {}) };
        const text = clock(time, parts, day);
        if (x < free || x + LETTER * text.length > width) continue;
        made.push(drawn("rect", { x, y: 23, width: 1, height: 4 }), drawn("text", { x, y: 38 }, text));
        free = x + LETTER * text.length + 12;
        day = new Date(time).toDateString();
      }
    }
    return made;
  }

  /** Show the state before or after the next mark. */
  _step(direction) {
    const marks = this._line?.marks || [], at = this._target ?? this._data.past ?? this._data.last;
    const next = direction > 0 ? marks.find((mark) => mark.sequence > at) : marks.filter((mark) => mark.sequence < at).at(-1);
    this._target = next ? next.sequence : direction > 0 ? null : this._line.first.sequence;
    return this.show(this._target === null ? null : String(this._target));
  }

  _play() {
    let step = this._data.past === null ? 0 : Number(this._input.value);
    byId("play").ariaPressed = "true";
    this._timer = setInterval(async () => {
      if (this._busy) return;
      step = Math.min(step + STEPS / FRAMES, STEPS);
      await this.show(this._timeAt(step));
      if (step >= STEPS) this._stop();
    }, 120);
  }

  _stop() {
    clearInterval(this._timer);
    this._timer = null;
    byId("play").ariaPressed = "false";
  }
}

function drawn(name, attributes, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

export class ChangePanel {
  /** `choose(change)` selects a changed thing, or goes to where it was. */
  constructor(data, view, choose) {
    this._data = data;
    this._view = view;
    this._choose = choose;
    this.from = null; // ISO 8601 or a number: the first of the two moments
    this._asked = new AbortController();
    byId("compare").addEventListener("click", () => this.compare(this.from === null ? this._data.time ?? String(this._data.last) : null));
  }

  /** Compare a moment with what is shown; null ends it. */
  async compare(from) {
    this.from = from;
    this._asked.abort();
    const { signal } = this._asked = new AbortController();
    byId("compare").setAttribute("aria-pressed", String(from !== null));
    byId("side").toggleAttribute("data-compared", from !== null);
    if (from === null) return this._clear();
    const to = this._data.past, given = new URLSearchParams({ from, ...(to === null ? {} : { to }) });
    try {
      const found = await read(`/diff?${given}`, { signal });
      if (to === this._data.past) this._show(found); // else the moment has changed meanwhile
    } catch (error) {
      if (!signal.aborted) this._clear(element("p", error.message));
    }
    return undefined;
  }

  _clear(...content) {
    byId("changes").replaceChildren(...content);
    this._view.changes = [];
    this._view.draw();
  }

  _show(found) {
    this._view.changes = found.changes;
    this._view.draw();
    const [before, after] = found.times.map((time) => clock(time));
    const listed = (rows, ending) => Object.entries(TITLES).flatMap(([kind, title]) => this._list(title + ending, rows.filter((one) => one.kind === kind), SIGNS[kind]));
    const lists = [...listed(found.rooms ?? [], ": rooms"), ...listed(found.changes, "")];
    byId("changes").replaceChildren(
      element("h2", `From ${before} to ${this._data.past === null ? "now" : after}`),
      ...(lists.length ? lists : [element("p", "No thing came, went, moved or got another name, and no room changed.")]),
      element("p", areasOf("Floor", found.floor)),
      ...(found.surface.some(Boolean) ? [element("p", areasOf("Surface", found.surface))] : []),
    );
  }

  _list(title, changes, sign = "") {
    if (!changes.length) return [];
    const head = element("h3", `${title} (${changes.length})`);
    head.dataset.sign = sign;
    return [head, folded("ul", changes, MAX_ENTRIES, (one) => element("li", "", this._link(one), this._wordsOf(one)))];
  }

  _link(one) {
    const there = this._data.thingAt(this._data.base + one.iri);
    return linkButton(() => this._choose(one), there ? named(this._data, there) : one.title ?? one.category);
  }

  _wordsOf({ kind, metres, before, after, place }) {
    const room = this._data.places.get(this._data.base + place);
    if (kind === "moved") return ` by ${metres.toFixed(2)} m`;
    if (before) return `: ${before}, now ${after}`;
    return room ? ` ${this._data.inPlace(room)}` : "";
  }
}

function areasOf(name, areas) {
  const [before, after] = areas.map((area) => `${area.toFixed(1)} m²`);
  return before === after ? `${name} seen: ${after}` : `${name} seen: ${before}, then ${after}`;
}
