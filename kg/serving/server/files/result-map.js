// An answer on the map: its things, positions and geometries are highlighted.
import { MapData, ringsOf } from "/files/map-data.js";
import { MapView } from "/files/map-view.js";
import { byId, status } from "/files/page-elements.js";
import { isNumeric } from "/files/result-table.js";

export class ResultMap {
  constructor(base) {
    this._data = new MapData(base);
    this._view = new MapView(byId("canvas"), this._data, (one) => one.existence >= 0.5 || this._view.highlights.iris.has(one.iri));
    this._view.onPick = (iri) => this._pick(iri);
  }

  /** Highlight columns and rows of SPARQL JSON; returns the number of things and geometries in words. */
  async show(answer) {
    await this._data.load();
    const found = highlightsOf(answer, (iri) => this._data.thingAt(iri) || this._data.places.has(iri));
    this._view.highlights = found;
    this._view.fit();
    return found.iris.size + found.points.length + found.rings.length;
  }

  _pick(iri) {
    const one = this._data.thingAt(iri) || this._data.places.get(iri);
    this._view.selected = iri;
    this._view.draw();
    if (one) status(`${this._data.nameOf(one)} (${this._data.pathOf(iri)})`);
  }
}

/** Things, points [m] and rings [m]: of each row the first thing of the map, otherwise x and y, and all WKT. */
function highlightsOf({ columns, rows }, isOnMap) {
  const iris = new Set(), points = [], rings = [];
  const hasPosition = columns.includes("x") && columns.includes("y");
  for (const row of rows) {
    const terms = columns.map((name) => row[name]).filter(Boolean);
    const thing = terms.find((term) => term.type === "uri" && isOnMap(term.value));
    if (thing) iris.add(thing.value);
    for (const ring of terms.filter(({ datatype = "" }) => datatype.endsWith("wktLiteral")).flatMap(({ value }) => ringsOf(value))) {
      if (ring.every((corner) => corner.slice(0, 2).every(Number.isFinite))) (ring.length > 1 ? rings : points).push(ring.length > 1 ? ring : ring[0]);
    }
    if (!thing && hasPosition && isNumeric(row.x) && isNumeric(row.y)) points.push([Number(row.x.value), Number(row.y.value)]);
  }
  return { iris, points, rings };
}
