// Edits of rooms on the page: buttons, and the clicks on the map that they ask for.
import { inside } from "/files/map-drawing.js";
import { button, byId, element, status } from "/files/page-elements.js";

/** Edits by their buttons: the words asked for another place, and for points.
 * @type {{kind: string, text: string, points?: string, other?: string}[]} */
const EDITS = [
  { kind: "split", text: "split", points: "click two points of the line that divides it" },
  { kind: "merge", text: "merge with", other: "click the place that becomes part of it" },
  { kind: "wall", text: "move the wall to", other: "click the place behind the wall",
    points: "click two points of the new wall" },
  { kind: "door", text: "mark a door to", other: "click the place behind the door", points: "click where the door is" },
  { kind: "draw", text: "draw a place", points: "click its corners, then press Enter" },
];
const COUNTS = { split: 2, wall: 2, door: 1, draw: Infinity };

export class RoomEdits {
  /** `send(edit)` writes an edit to the map; `view` shows what it will do. */
  constructor(data, view, send) {
    this._data = data;
    this._view = view;
    this._send = send;
    this._edit = null; // the edit that waits for clicks
    document.addEventListener("keydown", (event) => {
      if (!this._edit) return;
      if (event.key === "Escape") this.stop("nothing was changed");
      if (event.key === "Enter" && this._edit.kind === "draw") { event.preventDefault(); this._finish(); }
    });
  }

  /** The buttons for a place, or without one. */
  form(place) {
    const name = element("input"), kinds = EDITS.filter(({ kind }) => place || kind === "draw");
    name.setAttribute("aria-label", "name of a new place");
    name.placeholder = "name of a new place";
    return element("fieldset", "", element("legend", "Rooms"), element("p", "", name),
      element("p", "", ...kinds.map((edit) => button(edit.text, () => this._begin(edit, place?.iri, name.value)))),
      element("p", "", button("the robot is in this room", () => this.sendNow("here", name.value))));
  }

  /** Take a click on the map at a point [m]; false if no edit waits for one. */
  take([x, y]) {
    const edit = this._edit;
    if (!edit) return false;
    if (edit.other && edit.places.length < 2) {
      const place = [...this._data.places.values()].find((one) => inside(x, y, one.rings) && one.iri !== edit.places[0]);
      if (!place) { status(`that is no other place; ${edit.other}`); return true; }
      edit.places.push(place.iri);
    } else edit.points.push([Number(x.toFixed(2)), Number(y.toFixed(2))]);
    if (edit.points.length >= (COUNTS[edit.kind] || 0) && (!edit.other || edit.places.length === 2)) this._finish();
    else this._ask();
    return true;
  }

  /** @param {{kind: string, points?: string, other?: string}} edit */
  _begin({ kind, other, points: words }, iri, name) {
    this._edit = { kind, other, words, places: kind === "draw" ? [] : [iri], points: [], name };
    this._ask();
    byId("canvas").focus();
  }

  _ask() {
    const { kind, other, places, points, words } = this._edit;
    this._view.sketch = { points, cursor: null, isArea: kind === "draw" };
    this._view.draw();
    status(`${other && places.length < 2 ? other : words} (${points.length} points so far; Escape stops)`);
  }

  _finish() {
    const { kind, places, points, name } = this._edit;
    this.stop();
    this._send({ kind, places: places.map((iri) => this._data.pathOf(iri)), points, name });
  }

  /** Send an edit that needs no click. */
  sendNow(kind, name = "") {
    this.stop();
    this._send({ kind, places: [], points: [], name });
  }

  /** End the edit without a change. */
  stop(text = "") {
    if (text) status(text);
    this._edit = this._view.sketch = null;
    this._view.draw();
  }
}
