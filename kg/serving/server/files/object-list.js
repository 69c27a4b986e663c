// What is shown: filters, the objects that pass them with their number and legend, and all of it as files.
import { colourOf } from "/files/map-drawing.js";
import { seconds } from "/files/map-data.js";
import { button, byId, element, linkButton, named, option, percent, save } from "/files/page-elements.js";

const MAX_ENTRIES = 200; // of the list
const MAX_CATEGORIES = 40; // of the legend
const COLUMNS = ["iri", "name", "category", "x", "y", "z", "existence", "place", "lastSeen"]; // of a table

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
    for (const id of ["filter", "least", "in-place", "age"]) byId(id).addEventListener("input", () => this._read());
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
    byId("count").textContent = `${[objects.length, this._data.objects.size].map((count) => count.toLocaleString("en")).join(" of ")} objects, ${places} ${places === 1 ? "place" : "places"}${none}`;
    byId("count").title = `the others are less than ${percent(this.least)} sure, or pass no filter`;
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
      const label = this._data.labelOf(category), onclick = () => { byId("filter").value = label; this._read(); };
      const swatch = element("i", "", { style: `background: ${colourOf(label, dark)}` });
      return element("li", "", element("button", "", { type: "button", onclick }, swatch, ` ${label} `, element("b", String(count))));
    });
  }

  _entry(one, selected) {
    const made = linkButton(() => this._choose(one.iri), named(this._data, one), { ariaCurrent: String(one.iri === selected) });
    return element("li", "", made, element("span", ` ${this._data.whereabouts(one)}`));
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
    byId("least-shown").textContent = percent(this.least);
    this._changed();
  }
}

/** Offer what is shown as a picture, a table and shapes; `shown(object)` returns whether an object is drawn. */
export function offerExports(data, view, shown) {
  const objects = () => [...data.objects.values()].filter(shown).map((one) => recordOf(data, one));
  /** @type {Record<string, [string, () => any]>} */
  const files = {
    PNG: ["map.png", () => view.toBlob()],
    CSV: ["objects.csv", () => new Blob([tableOf(objects())], { type: "text/csv" })],
    GeoJSON: ["map.geojson", () => new Blob([JSON.stringify(shapesOf(data, objects()))], { type: "application/geo+json" })],
  };
  byId("exports").replaceChildren(...Object.entries(files).map(([name, [file, make]]) => button(name, async () => save(file, await make()))));
}

function recordOf(data, { iri, class: category, x, y, z = "", existence, place, seen = "" }) {
  return { iri, name: data.nameAt(iri), category: data.labelOf(category), x, y, z, existence, place: place ? data.nameAt(place) : "", lastSeen: seen };
}

/** CSV (RFC 4180); a text that a spreadsheet would take for a formula gets an apostrophe. */
function tableOf(rows) {
  const cell = (value) => {
    const text = typeof value === "string" && /^[=+\-@\t\r]/.test(value) ? `'${value}` : String(value);
    return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return [COLUMNS, ...rows.map((row) => COLUMNS.map((name) => row[name]))].map((row) => `${row.map(cell).join(",")}\r\n`).join("");
}

/** GeoJSON in metres of the map frame, which a member says. */
function shapesOf(data, rows) {
  const feature = (geometry, properties) => ({ type: "Feature", geometry, properties });
  const points = rows.map((row) => feature({ type: "Point", coordinates: [row.x, row.y] }, row));
  const places = [...data.places.values()].map((place) => feature(
    { type: "Polygon", coordinates: place.rings.map((ring) => [...ring, ring[0]]) }, { iri: place.iri, name: data.nameOf(place) }));
  return { type: "FeatureCollection", coordinates: "metres in the frame of the map", moment: data.time ?? "now", features: [...points, ...places] };
}
