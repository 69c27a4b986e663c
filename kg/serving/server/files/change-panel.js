// What changed from one moment to the shown one: a list, and signs on the map.
import { byId, element, linkButton, named } from "/files/page-elements.js";
import { read } from "/files/server.js";
import { clock } from "/files/time-axis.js";

const TITLES = { appeared: "Appeared", gone: "Gone", moved: "Moved", relabelled: "Other names", reshaped: "Other shape" };
const MAX_ENTRIES = 100; // of each kind

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
    const listed = (rows, ending) => Object.entries(TITLES).flatMap(([kind, title]) => this._list(title + ending, rows.filter((one) => one.kind === kind)));
    const lists = [...listed(found.rooms ?? [], ": rooms"), ...listed(found.changes, "")];
    byId("changes").replaceChildren(
      element("h2", `From ${before} to ${this._data.past === null ? "now" : after}`),
      ...(lists.length ? lists : [element("p", "No thing came, went, moved or got another name, and no room changed.")]),
      element("p", areasOf("floor", found.floor)),
      ...(found.surface.some(Boolean) ? [element("p", areasOf("surface", found.surface))] : []),
    );
  }

  _list(title, changes) {
    if (!changes.length) return [];
    const entries = changes.slice(0, MAX_ENTRIES).map((one) => element("li", "", this._link(one), this._wordsOf(one)));
    const more = changes.length - entries.length;
    return [element("h3", `${title} (${changes.length})`), element("ul", "", ...entries), ...(more > 0 ? [element("p", `and ${more} more`)] : [])];
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
  return before === after ? `${after} of ${name} seen` : `${name} seen: ${before}, then ${after}`;
}
