// Corrections on the page: assertions by the holder of a token.
import { button, byId, element, option, status } from "/files/page-elements.js";
import { RoomEdits } from "/files/room-edits.js";
import { hasToken, request, useToken } from "/files/server.js";

export class Corrections {
  /** `done()` is called when the token or the map has changed. */
  constructor(data, done) {
    this._data = data;
    this._done = done;
    this._rooms = new RoomEdits(data, (edit) =>
      this._send("/rooms", { method: "POST", body: JSON.stringify(edit) }, `rooms: ${edit.kind}`));
    this._author = ""; // holder of the token
    this._moving = null; // IRI of the object that the next click on the map positions
    byId("corrector")?.addEventListener("submit", (event) => this._take(event));
  }

  /** Suggest the names of the categories in the field for a category. */
  offerCategories() {
    for (const kind of ["object", "place"]) {
      const known = [...this._data.labels].filter(([iri]) => this._data.kinds.get(iri) === kind);
      byId(`${kind}-categories`).replaceChildren(...known.map(([, label]) => option(label, "")));
    }
  }

  /** The form for a thing; null without a token. */
  form(thing) {
    if (!hasToken() || !byId("corrector") || this._data.past !== null) return null; // the past cannot be written
    const isPlace = this._data.places.has(thing.iri);
    const name = element("input"), category = element("input");
    name.value = thing.label || "";
    name.setAttribute("aria-label", "name");
    category.setAttribute("list", isPlace ? "place-categories" : "object-categories");
    category.setAttribute("aria-label", "category");
    category.placeholder = isPlace ? "e.g. kitchen" : "e.g. coffee machine";
    const made = element("fieldset", "", element("legend", "Correct it"),
      element("p", "", name, button("rename", () => this._assert(thing.iri, "label", name.value))),
      element("p", "", category, button("is a", () => this._assert(thing.iri, isPlace ? "category" : "name", category.value))));
    if (!isPlace) {
      made.append(element("p", "",
        button("move", () => { this._moving = thing.iri; status("click where it is"); }),
        button("it is not there", () => this._assert(thing.iri, "existence", "absent"))));
    }
    made.append(element("p", "", button("undo", () => this._retract(thing.iri))));
    if (isPlace) made.append(this._rooms.form(thing));
    return made;
  }

  /** Use a clicked position [m] for a correction; false if none waits for one. */
  place([x, y]) {
    if (this._rooms.take([x, y])) return true;
    const iri = this._moving;
    this._moving = null;
    if (iri) this._assert(iri, "position", `${x.toFixed(2)} ${y.toFixed(2)} ${(this._data.thingAt(iri)?.z ?? 0).toFixed(2)}`);
    return iri !== null;
  }

  async _take(event) {
    event.preventDefault();
    useToken(byId("token").value.trim());
    byId("token").value = "";
    if (hasToken() && !await this._isGood()) {
      useToken("");
      status("this token may not write to this map");
    } else status(hasToken() ? "corrections are open until the page is left" : "");
    this._done();
  }

  /** Whether the server knows the author of the token. */
  async _isGood() {
    try {
      const { author } = await (await request("/health", { accept: "application/json" })).json();
      this._author = author || "";
      return Boolean(author);
    } catch {
      return false; // a private map refuses a wrong token
    }
  }

  _assert(iri, property, value) {
    const body = JSON.stringify({ thing: this._data.pathOf(iri), property, value });
    return this._send("/assertions", { method: "POST", body }, `${property}: ${value}`);
  }

  /** Retract one's own last assertion about a thing; those of others stay. */
  async _retract(iri) {
    const address = `/assertions?iri=${encodeURIComponent(this._data.pathOf(iri))}`;
    try {
      const { assertions } = await (await request(address, { accept: "application/json" })).json();
      const own = assertions.filter((one) => one.by === this._author);
      const last = own.sort((a, b) => (a.time > b.time ? 1 : -1)).pop();
      if (!last) {
        const others = [...new Set(assertions.map((one) => one.by))].join(", ");
        return status(others ? `nothing of yours is left to undo: what is asserted is by ${others}` : "nothing was asserted about it");
      }
      return this._send(`${address}&property=${last.property}`, { method: "DELETE" }, `retracted: ${last.property}`);
    } catch (error) {
      return status(error.message);
    }
  }

  async _send(address, options, done) {
    try {
      const answer = await request(address, { ...options, accept: "application/json", type: "application/json" });
      const { notes = [] } = await answer.json();
      status([done, ...notes].join("; "));
      setTimeout(this._done, 700);
    } catch (error) {
      status(error.message);
    }
  }
}
