// Filters, and the objects that pass them: number, legend and list.
import { colourOf } from "/files/map-drawing.js";
import { seconds } from "/files/map-data.js";
import { button, byId, element, named, option } from "/files/page-elements.js";

const MAX_ENTRIES = 200; // of the list
const MAX_CATEGORIES = 40; // of the legend

export class ObjectList {
  /** `choose(iri)` selects an object; `changed()` is called when the filters change. */
  constructor(data, choose, changed) {
    this._data = data;
    this._choose = choose;
    this._changed = changed;
    this.least = 0.5; // existence
    this._text = "";
    this._place = "";
    this._age = Infinity; // [s]
    this._now = 0;
    ["filter", "least"].forEach((id) => byId(id).addEventListener("input", () => this._read()));
    ["in-place", "age"].forEach((id) => byId(id).addEventListener("change", () => this._read()));
  }

  /** Set the fields by their ids; `place` is the IRI of a place, or empty. */
  filter(values, place) {
    for (const [id, value] of Object.entries(values)) byId(id).value = value;
    this._offerPlaces(place || "");
    this._read();
  }

  /** Whether an object passes the filters. */
  passes(one) {
    if (!(one.existence >= this.least)) return false;
    if (this._place && one.place !== this._place) return false;
    if (this._age !== Infinity && !(this._now - seconds(one.seen || 0) <= this._age)) return false;
    const names = [this._data.nameOf(one), this._data.labelOf(one.class)];
    return !this._text || names.some((name) => name.toLowerCase().includes(this._text));
  }

  /** List the objects that pass; `selected` is an IRI, `dark` selects the colours of a dark page. */
  show(shown, selected, dark) {
    this._now = this._data.lastView();
    const objects = [...this._data.objects.values()].filter(shown);
    const places = this._data.places.size;
    const none = this._data.objects.size && !objects.length ? ": none passes the filters" : "";
    byId("count").textContent = `${objects.length} of ${this._data.objects.size} objects, ${places} ${places === 1 ? "place" : "places"}${none}`;
    byId("poses").textContent = this._data.poses.map((line) => `Estimated from the images: ${line}.`).join(" ");
    byId("legend").replaceChildren(...this._legend(objects, dark));
    const surest = objects.sort((a, b) => b.existence - a.existence || (a.iri < b.iri ? -1 : 1)).slice(0, MAX_ENTRIES);
    byId("objects").replaceChildren(...surest.map((one) => this._entry(one, selected)));
    this._offerPlaces();
  }

  _legend(objects, dark) {
    const counts = new Map();
    for (const one of objects) counts.set(one.class, (counts.get(one.class) || 0) + 1);
    return [...counts].sort((a, b) => b[1] - a[1]).slice(0, MAX_CATEGORIES).map(([category, count]) => {
      const label = this._data.labelOf(category), swatch = element("i");
      swatch.style.background = colourOf(label, dark);
      const made = button("", () => { byId("filter").value = label; this._read(); });
      made.append(swatch, ` ${label} `, element("b", String(count)));
      return element("li", "", made);
    });
  }

  _entry(one, selected) {
    const place = this._data.places.get(one.place);
    const made = button("", () => this._choose(one.iri));
    made.className = "link";
    made.append(...named(this._data, one));
    made.setAttribute("aria-current", String(one.iri === selected));
    const where = place ? `${this._data.inPlace(place)}, ` : "";
    return element("li", "", made, element("span", ` ${where}${Math.round(100 * one.existence)} % sure`));
  }

  _offerPlaces(chosen = byId("in-place").value) {
    const places = byId("in-place");
    const options = [...this._data.places.values()].map((place) => option(place.iri, this._data.nameOf(place)));
    places.replaceChildren(option("", "anywhere"), ...options);
    places.value = this._data.places.has(chosen) ? chosen : "";
  }

  _read() {
    this._text = byId("filter").value.trim().toLowerCase();
    this._place = byId("in-place").value;
    this.least = Number(byId("least").value);
    this._age = Number(byId("age").value) || Infinity;
    this._now = this._data.lastView();
    byId("least-shown").textContent = `${Math.round(100 * this.least)} %`;
    this._changed();
  }
}
