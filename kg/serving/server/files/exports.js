// What is shown, as files: a picture, a table, or shapes.
import { button, byId, save } from "/files/page-elements.js";

const COLUMNS = ["iri", "name", "category", "x", "y", "z", "existence", "place", "lastSeen"];

/** Offer buttons; `shown(object)` returns whether an object is drawn. */
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

function recordOf(data, one) {
  const place = data.places.get(one.place), label = data.labelOf(one.class);
  return { iri: one.iri, name: data.nameOf(one), category: label, x: one.x, y: one.y, z: one.z ?? "", existence: one.existence,
    place: place ? data.nameOf(place) : "", lastSeen: one.seen ?? "" };
}

/** CSV (RFC 4180); a text that a spreadsheet would take for a formula gets an apostrophe. */
function tableOf(rows) {
  const cell = (value) => {
    const text = typeof value === "string" && /^[=+\-@\t\r]/.test(value) ? `'${value}` : String(value);
    return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return [COLUMNS, ...rows.map((row) => COLUMNS.map((name) => row[name]))].map((row) => `${row.map(cell).join(",")}\r\n`).join("");
}

/** GeoJSON in metres of the map frame, which a member says: without a place on Earth there are no degrees. */
function shapesOf(data, rows) {
  const feature = (geometry, properties) => ({ type: "Feature", geometry, properties });
  const closed = (ring) => [...ring, ring[0]];
  return {
    type: "FeatureCollection", coordinates: "metres in the frame of the map", moment: data.time ?? "now",
    features: [
      ...rows.map((row) => feature({ type: "Point", coordinates: [row.x, row.y] }, row)),
      ...[...data.places.values()].map((place) => feature({ type: "Polygon", coordinates: place.rings.map(closed) },
        { iri: place.iri, name: data.nameOf(place) })),
    ],
  };
}
