// Corrections by the holder of a token: assertions about things, edits of rooms, and clicks on the map for them.
import { inside } from "/files/map-drawing.js";
import { button, byId, element, option, reveal, status } from "/files/page-elements.js";
import { hasToken, read, useToken } from "/files/server.js";

/** Edits of rooms by their buttons: the words that ask for another place and for points, and how many points each takes.
 * @type {{kind: string, text?: string, count: number, points?: string, other?: string}[]} */
const EDITS = [
  { kind: "split", text: "split", count: 2, points: "click two points of the line that divides it" },
  { kind: "merge", text: "merge with", count: 0, other: "click the place that becomes part of it" },
  { kind: "wall", text: "move the wall to", count: 2, other: "click the place behind the wall", points: "click two points of the new wall" },
  { kind: "door", text: "mark a door to", count: 1, other: "click the place behind the door", points: "click where the door is" },
  { kind: "draw", text: "draw a place", count: Infinity, points: "click its corners, then press Enter" },
];
const INVALID = 401; // the status of a token that the server does not know
const MOVE = { kind: "move", count: 1, points: "click where it is" }; // of an object

export class Corrections {
  /** `view` shows what an edit will do; `done()` is called when the token or the map has changed. */
  constructor(data, view, done) {
    this._data = data;
    this._view = view;
    this._done = done;
    this._author = ""; // holder of the token
    /** @type {(string | null)[]} */
    this._made = []; // edits of this page: the thing of each, or null for rooms
    this._edit = null; // the edit that waits for clicks
    this._thing = null; // that is selected
    this._past = data.past;
    data.addEventListener("changed", () => { if (this._data.past !== this._past) this._renew(); });
    byId("corrector")?.addEventListener("submit", (event) => this._unlock(event));
    reveal("edit", byId("corrector") !== null);
    byId("edit").addEventListener("click", () => this._turn(byId("edit").ariaPressed !== "true"));
    document.addEventListener("keydown", (event) => {
      if (!this._edit) return;
      if (event.key === "Escape") this._stop("nothing was changed");
      if (event.key === "Enter" && this._edit.kind === "draw") { event.preventDefault(); this._finish(); }
    });
  }

  /** Begin to edit, or end that. */
  _turn(isOn) {
    byId("edit").ariaPressed = String(isOn);
    reveal("editing", isOn);
    byId("map").classList.toggle("edited", isOn);
    this._renew();
    if (isOn && !hasToken()) byId("token").focus();
  }

  /** Offer the tools of the moment that is shown. */
  _renew() {
    this._past = this._data.past;
    this._stop();
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
    const tools = byId("tools"), isPast = this._data.past !== null;
    if (!tools || (!isPast && tools.contains(document.activeElement) && document.activeElement.matches("input"))) return;
    reveal("corrector", !hasToken());
    if (!hasToken()) tools.replaceChildren();
    else if (isPast) tools.replaceChildren(element("p", "The past cannot be edited: choose now."));
    else {
      tools.replaceChildren(thing ? this._thingTools(thing) : element("p", "Select what to edit: click on the map or in the list."),
        this._roomTools(this._data.places.has(thing?.iri) ? thing : null), element("p", "", button("undo my last edit", () => this._undo())));
    }
  }

  _thingTools({ iri, label = "" }) {
    const isPlace = this._data.places.has(iri), name = field("name", { value: label });
    const category = field("category", { placeholder: isPlace ? "e.g. kitchen" : "e.g. coffee machine" });
    category.setAttribute("list", isPlace ? "place-categories" : "object-categories");
    const made = element("fieldset", "", element("legend", this._data.nameAt(iri)),
      element("p", "", name, button("rename", () => this._assert(iri, "label", name.value))),
      element("p", "", category, button("is a", () => this._assert(iri, isPlace ? "category" : "name", category.value))));
    if (isPlace) return made;
    made.append(element("p", "", button("move", () => this._begin(MOVE, iri)), button("it is not there", () => this._assert(iri, "existence", "absent"))));
    return made;
  }

  /** The buttons for a place, or without one. */
  _roomTools(place) {
    const name = field("name of a new place", { placeholder: "name of a new place" }), edits = EDITS.filter(({ kind }) => place || kind === "draw");
    return element("fieldset", "", element("legend", "Rooms"), element("p", "", name),
      element("p", "", ...edits.map((edit) => button(edit.text, () => this._begin(edit, place?.iri, name.value)))),
      element("p", "", button("the robot is in this room", () => this._editRooms("here", [], [], name.value))));
  }

  _begin(edit, iri, name = "") {
    this._edit = { ...edit, things: edit.kind === "draw" ? [] : [iri], clicked: [], name };
    this._ask();
    byId("canvas").focus();
  }

  /** Take a click on the map at a point [m]; false if no edit waits for one. */
  place([x, y]) {
    const edit = this._edit;
    if (!edit) return false;
    if (edit.other && edit.things.length < 2) {
      const place = [...this._data.places.values()].find((one) => inside(x, y, one.rings) && one.iri !== edit.things[0]);
      if (!place) { status(`that is no other place; ${edit.other}`); return true; }
      edit.things.push(place.iri);
    } else edit.clicked.push([Number(x.toFixed(2)), Number(y.toFixed(2))]);
    if (edit.clicked.length >= edit.count && (!edit.other || edit.things.length === 2)) this._finish();
    else this._ask();
    return true;
  }

  _ask() {
    const { kind, other, things, clicked, points } = this._edit, moved = kind === "move" ? this._data.thingAt(things[0]) : null;
    this._view.sketch = { points: moved ? [[moved.x, moved.y]] : clicked, cursor: null, isArea: kind === "draw" };
    this._view.draw();
    status(`${other && things.length < 2 ? other : points} (${clicked.length || "no"} ${clicked.length === 1 ? "point" : "points"} so far; Escape stops)`);
  }

  _finish() {
    const { kind, things, clicked, name } = this._edit;
    if (kind !== "move") { this._editRooms(kind, things, clicked, name); return; }
    const [iri] = things, height = this._data.thingAt(iri)?.z ?? 0;
    this._stop();
    this._assert(iri, "position", [...clicked[0], height].map((value) => value.toFixed(2)).join(" "));
  }

  /** End the edit without a change. */
  _stop(text = "") {
    if (text) status(text);
    this._edit = this._view.sketch = null;
    this._view.draw();
  }

  async _unlock(event) {
    event.preventDefault();
    useToken(byId("token").value.trim());
    byId("token").value = "";
    this._author = hasToken() ? (await read("/health").catch(() => ({}))).author || "" : ""; // a private map refuses a wrong token
    if (hasToken() && !this._author) {
      useToken("");
      status("this token may not write to this map");
    } else status(hasToken() ? "corrections are open until the page is left" : "");
    this.offer();
    this._done();
  }

  _assert(iri, property, value) {
    const body = JSON.stringify({ thing: this._data.pathOf(iri), property, value });
    return this._send("/assertions", { method: "POST", body }, `${property}: ${value}`, iri);
  }

  _editRooms(kind, places = [], points = [], name = "") {
    this._stop();
    const body = JSON.stringify({ kind, places: places.map((iri) => this._data.pathOf(iri)), points, name });
    return this._send("/rooms", { method: "POST", body }, `rooms: ${kind}`, kind === "undo" ? undefined : null);
  }

  /** Undo the last edit of this page; before the first, one's last about the selected thing, or else of rooms. */
  _undo() {
    const iri = this._made.length ? this._made.pop() : this._thing?.iri;
    return iri ? this._retract(iri) : this._editRooms("undo");
  }

  /** Retract one's own last assertion about a thing; those of others stay. */
  async _retract(iri) {
    const address = `/assertions?iri=${encodeURIComponent(this._data.pathOf(iri))}`;
    try {
      const { assertions } = await read(address);
      const own = assertions.filter((one) => one.by === this._author);
      const last = own.sort((a, b) => (a.time > b.time ? 1 : -1)).pop();
      if (last) return this._send(`${address}&property=${last.property}`, { method: "DELETE" }, `retracted: ${last.property}`);
      const others = [...new Set(assertions.map((one) => one.by))].join(", ");
      return status(others ? `nothing of yours is left to undo: what is asserted is by ${others}` : "nothing was asserted about it");
    } catch (error) {
      return this._refuse(error);
    }
  }

  /** Write something to the map; `about` is the thing that may be undone by this page, or null for rooms. */
  async _send(address, options, done, about = undefined) {
    try {
      const { notes = [] } = await read(address, options);
      if (about !== undefined) this._made.push(about);
      status([done, ...notes].join("; "));
      setTimeout(this._done, 700);
    } catch (error) {
      this._refuse(error);
    }
  }

  /** Tell why nothing was written; a token that is no longer valid is asked for again. */
  _refuse(error) {
    status(error.message);
    if (error.status !== INVALID) return;
    useToken("");
    this.offer();
    byId("token").focus();
  }
}

/** A field with a name for screen readers. */
const field = (ariaLabel, given) => element("input", "", { ariaLabel, ...given });
