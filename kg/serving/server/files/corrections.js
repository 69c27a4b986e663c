// Corrections on the page: assertions by the holder of a token.
import { button, byId, element, option, status } from "/files/page-elements.js";
import { RoomEdits } from "/files/room-edits.js";
import { hasToken, request, useToken } from "/files/server.js";

export class Corrections {
  /** `done()` is called when the token or the map has changed. */
  constructor(data, view, done) {
    this._data = data;
    this._view = view;
    this._done = done;
    this._rooms = new RoomEdits(data, view, (edit) => this._send("/rooms", { method: "POST", body: JSON.stringify(edit) }, `rooms: ${edit.kind}`, edit.kind === "undo" ? undefined : null));
    this._author = ""; // holder of the token
    /** @type {(string | null)[]} */
    this._edits = []; // of this page: the thing of each, or null for rooms
    this._moving = null; // IRI of the object that the next click on the map positions
    this._thing = null; // that is selected
    this._past = data.past;
    data.addEventListener("changed", () => this._follow());
    byId("corrector")?.addEventListener("submit", (event) => this._take(event));
    byId("edit").classList.toggle("hidden", !byId("corrector"));
    byId("edit").addEventListener("click", () => this._turn(byId("edit").ariaPressed !== "true"));
  }

  /** Begin to edit, or end that. */
  _turn(isOn) {
    byId("edit").ariaPressed = String(isOn);
    byId("editing").classList.toggle("hidden", !isOn);
    byId("map").classList.toggle("edited", isOn);
    this._rooms.stop();
    this._moving = null;
    this.offer();
    if (isOn && !hasToken()) byId("token").focus();
  }

  /** Tools are those of the moment that is shown. */
  _follow() {
    if (this._data.past === this._past) return;
    this._past = this._data.past;
    this._rooms.stop();
    this._moving = null;
    this.offer();
  }

  /** Suggest the names of the categories in the field for a category. */
  offerCategories() {
    for (const kind of ["object", "place"]) {
      const known = [...this._data.labels].filter(([iri]) => this._data.kinds.get(iri) === kind);
      byId(`${kind}-categories`)?.replaceChildren(...known.map(([, label]) => option(label, "")));
    }
  }

  /** Offer the tools for the selected thing, where one may edit. */
  offer(thing = this._thing) {
    this._thing = thing;
    const tools = byId("tools");
    if (!tools || this._data.past === null && tools.contains(document.activeElement) && document.activeElement.matches("input")) return;
    byId("corrector").classList.toggle("hidden", hasToken());
    if (!hasToken()) tools.replaceChildren();
    else if (this._data.past !== null) tools.replaceChildren(element("p", "The past cannot be edited: choose now."));
    else tools.replaceChildren(...(thing ? [this._form(thing)] : [element("p", "Select what to edit: click on the map or in the list.")]), this._rooms.form(this._data.places.has(thing?.iri) ? thing : null),
      element("p", "", button("undo my last edit", () => this._undo())));
  }

  _form(thing) {
    const isPlace = this._data.places.has(thing.iri);
    const name = element("input"), category = element("input");
    name.value = thing.label || "";
    name.setAttribute("aria-label", "name");
    category.setAttribute("list", isPlace ? "place-categories" : "object-categories");
    category.setAttribute("aria-label", "category");
    category.placeholder = isPlace ? "e.g. kitchen" : "e.g. coffee machine";
    const made = element("fieldset", "", element("legend", this._data.nameOf(thing)),
      element("p", "", name, button("rename", () => this._assert(thing.iri, "label", name.value))),
      element("p", "", category, button("is a", () => this._assert(thing.iri, isPlace ? "category" : "name", category.value))));
    if (!isPlace) {
      made.append(element("p", "",
        button("move", () => { this._moving = thing.iri; this._view.sketch = { points: [[thing.x, thing.y]], cursor: null }; status("click where it is"); }),
        button("it is not there", () => this._assert(thing.iri, "existence", "absent"))));
    }
    return made;
  }

  /** Use a clicked position [m] for a correction; false if none waits for one. */
  place([x, y]) {
    if (this._rooms.take([x, y])) return true;
    const iri = this._moving;
    if (iri) this._moving = this._view.sketch = null;
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
    this.offer();
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
    return this._send("/assertions", { method: "POST", body }, `${property}: ${value}`, iri);
  }

  /** Undo the last edit of this page; before the first, one's last about the selected thing, or else of rooms. */
  async _undo() {
    const iri = this._edits.length ? this._edits.pop() : this._thing?.iri;
    if (iri) await this._retract(iri);
    else this._rooms.sendNow("undo");
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

  /** Write something to the map; `about` is the thing that may be undone by this page, or null for rooms. */
  async _send(address, options, done, about = undefined) {
    try {
      const answer = await request(address, { ...options, accept: "application/json", type: "application/json" });
      const { notes = [] } = await answer.json();
      if (about !== undefined) this._edits.push(about);
      status([done, ...notes].join("; "));
      setTimeout(this._done, 700);
    } catch (error) {
      status(error.message);
    }
  }
}
