// The data of the page: the state of the map at one moment, updated by the feed of changes if that is now.
import { chance } from "/files/page-elements.js";
import { followChanges, read } from "/files/server.js";

const HERE = "https://w3id.org/hereabouts#";
const RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type";
const LABEL = "http://www.w3.org/2000/01/rdf-schema#label";
const UNNAMED = `${HERE}UnnamedThing`;
const MAP_GRAPH = "https://w3id.org/hereabouts/graph/map";

/** Field of an object by predicate in the feed. */
const FIELDS = {
  [RDF_TYPE]: "class", [LABEL]: "label", [`${HERE}x`]: "x", [`${HERE}y`]: "y", [`${HERE}z`]: "z",
  [`${HERE}existence`]: "existence", [`${HERE}inPlace`]: "place", [`${HERE}lastSeen`]: "seen",
  [`${HERE}positionDeviation`]: "deviation", [`${HERE}yaw`]: "yaw", [`${HERE}extentX`]: "dx", [`${HERE}extentY`]: "dy",
  [`${HERE}extentZ`]: "dz", [`${HERE}observationCount`]: "count", [`${HERE}heading`]: "heading",
};
const TEXTS = new Set(["class", "label", "place", "seen"]); // fields that are no numbers

/** The bytes of a zlib stream in base64. */
async function inflated(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Rings of corners [x, y] of a polygon in WKT. */
export function ringsOf(text) {
  return [...text.matchAll(/\(([^()]+)\)/g)].map((ring) =>
    ring[1].split(",").map((corner) => corner.trim().split(/\s+/).map(Number)));
}

function cornersOf({ outline, xmin, xmax, ymin, ymax }) {
  return outline ? ringsOf(outline) : [[[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]]];
}

const QUAD = /^<([^>]*)> <([^>]*)> (?:<([^>]*)>|"((?:[^"\\]|\\.)*)"\S*) <([^>]*)> \.$/;

/** The facts {subject, predicate, value} of graph:map in lines of N-Quads. */
function factsOf(lines) {
  return lines.map((line) => QUAD.exec(line)).filter((found) => found?.[5] === MAP_GRAPH)
    .map(([, subject, predicate, iri, text]) => ({ subject, predicate, value: iri ?? JSON.parse(`"${text.replace(/\\'/g, "'")}"`) }));
}

/** A time of the map as seconds since 1970. */
export const seconds = (time) => Date.parse(time) / 1000;

export class MapData extends EventTarget {
  constructor(base) {
    super();
    this.base = base;
    this.objects = new Map();
    this.things = new Map(); // without a name
    this.places = new Map();
    this.doors = [];
    this.floor = [];
    this.robot = null;
    this.trail = [];
    this.sequence = 0; // of the shown state
    this.version = 0; // of the objects and things
    this.surface = 0; // version of its surface
    this.poses = []; // a line for each recording with estimated poses
    this.last = 0; // of the map's last transaction
    this.past = null; // number of the shown past transaction; null for the present
    this.labels = new Map([[UNNAMED, "unnamed thing"]]); // of categories
    this.kinds = new Map([[UNNAMED, "thing"]]); // "object" or "place" of each category
    this._tiles = new Map(); // by the text of their cells
    this.time = null; // ISO 8601, of the shown past state
    this._others = new Set(); // classes in the feed that are no categories
    this._loading = new AbortController(); // of the last request
    this._missed = null;
  }

  /** Read the state at `at` (ISO 8601 or the number of a transaction), or the present state.
   *
   * Returns whether it is shown; false if another state was requested meanwhile. */
  async load(at = null) {
    this._loading.abort();
    const { signal } = this._loading = new AbortController();
    this._missed = []; // changes that arrive while the present is read
    try {
      const state = await this._read(at === null ? {} : { at }, signal);
      if (signal.aborted) return false;
      this._show(state, at !== null);
    } catch (error) {
      if (signal.aborted) return false;
      throw error;
    } finally { if (!signal.aborted) this._missed = null; }
    return true;
  }

  /** The answer of `/state`, with the tiles of its floor unpacked. */
  async _read(given, signal) {
    const state = await read(`/state?${new URLSearchParams(given)}`, { signal });
    return { ...state, floor: (await Promise.all(state.floor.map((tile) => this._tile(tile)))).filter(Boolean) };
  }

  _show(state, isPast) {
    this.past = isPast ? state.sequence : null;
    this.time = isPast ? state.time : null;
    this.sequence = state.sequence;
    this.last = Math.max(this.last, this.sequence);
    this._takeCategories(state);
    const byIri = (rows, more) => new Map(rows.map((one) =>
      [this.base + one.iri, { ...one, ...more, iri: this.base + one.iri, place: one.place && this.base + one.place }]));
    this.objects = byIri(state.objects, {});
    this.things = byIri(state.things, { class: UNNAMED });
    this.version++;
    this.trail = [];
    this._takeSurroundings(state);
    const missed = this._missed || [];
    this._missed = null;
    if (!isPast) missed.filter((change) => change.sequence > state.sequence).forEach((change) => this._take(change));
    this._tell("changed");
  }

  _takeSurroundings({ places, doors, floor, surface = 0, poses = [], robot }) {
    Object.assign(this, { doors, floor, surface, poses });
    this.places = new Map(places.map((row) => [this.base + row.iri, { ...row, iri: this.base + row.iri, rings: cornersOf(row) }]));
    this.robot = robot && { ...robot, iri: this.fullOf(robot.iri) };
  }

  _takeCategories({ categories }) {
    for (const [kind, labels] of Object.entries(categories)) for (const iri in labels) { this.labels.set(iri, labels[iri]); this.kinds.set(iri, kind); }
  }

  /** Height of the floor [m] in most of the map. */
  ground() {
    if (this.floor !== this._groundOf) {
      const heights = this.floor.map((tile) => tile.z ?? 0).sort((a, b) => a - b);
      this._ground = heights[heights.length >> 1] ?? 0;
      this._groundOf = this.floor;
    }
    return this._ground;
  }

  /** Follow the feed of changes after the state that was read. */
  follow() {
    followChanges(this.sequence, {
      onOpen: () => this._tell("on"),
      onClosed: () => this._tell("off"),
      onChange: (change) => this._take(change),
      onGap: () => this._readAnew(),
    });
  }

  /** Read everything again; returns the number of the map's last transaction. */
  async _readAnew() {
    const { sequence } = await read("/health");
    this.last = sequence;
    await this.load(this.past);
    return this.past === null ? this.sequence : sequence;
  }

  /** An object, or a thing without a name. */
  thingAt(iri) {
    return this.objects.get(iri) || this.things.get(iri);
  }

  has(iri) {
    return Boolean(this.thingAt(iri)) || this.places.has(iri);
  }

  labelOf(iri) {
    return this.labels.get(iri) || iri.replace(/^.*[/#]/, "");
  }

  nameOf(one) {
    return one.title || one.label || this.labelOf(one.class || one.iri);
  }

  /** The name of what has an IRI. */
  nameAt(iri) {
    const one = this.thingAt(iri) || this.places.get(iri);
    return one ? this.nameOf(one) : this.pathOf(iri);
  }

  /** A thing or place in a sentence: "the kitchen", "place 3 (bedroom)". */
  theNameOf(one) {
    const name = this.nameOf(one);
    return /^(?!the )\p{Ll}[^\d(]*$/u.test(name) ? `the ${name}` : name;
  }

  /** A place in a sentence: "in the kitchen". */
  inPlace(place) {
    return `in ${this.theNameOf(place)}`;
  }

  /** Where an object is and how sure that is: "in the kitchen, 80 % sure". */
  whereabouts(one) {
    const place = this.places.get(one.place);
    return `${place ? `${this.inPlace(place)}, ` : ""}${chance(one.existence)} sure`;
  }

  /** The name of a thing in two parts: without the number that the map gave it, and the number, perhaps "". */
  partsOf(one) {
    const name = this.nameOf(one), [, word, number] = /^(.*) (\d+)$/.exec(name) ?? [null, name, ""];
    return number && one.class && word === this.labelOf(one.class) ? [word, number] : [name, ""];
  }

  /** An IRI as this map's pages write it: without the base for things of the map. */
  pathOf(iri) {
    return iri.startsWith(this.base) ? iri.slice(this.base.length) : iri;
  }

  /** The IRI of a path, as `pathOf` writes it. */
  fullOf(path) {
    return path.includes(":") ? path : this.base + path;
  }

  /** The time of the map: its latest view, in seconds since 1970. */
  lastView() {
    let latest = 0;
    for (const one of this.objects.values()) if (one.seen) latest = Math.max(latest, seconds(one.seen));
    return latest;
  }

  /** Take a change of the feed. */
  _take(change) {
    this.last = Math.max(this.last, change.sequence);
    this._tell("transaction", change);
    this._missed?.push(change);
    if (this.past !== null) return;
    this.sequence = change.sequence;
    const removed = factsOf(change.removed), added = factsOf(change.added);
    const isAround = ({ subject }) => (this.robot ? /^(place|door|floor)\// : /^((place|door|floor)\/|robot$)/).test(this.pathOf(subject));
    const isField = (fact) => FIELDS[fact.predicate] && !isAround(fact);
    const touched = new Set([...removed.filter(isField).map((fact) => this._remove(fact)), ...added.filter(isField).map((fact) => this._add(fact))]);
    for (const one of touched) {
      if (!one) continue;
      if (one === this.robot) this.trail.push([one.x, one.y]);
      else { this._sort(one); this.version++; }
    }
    if (this.trail.length > 2000) this.trail.splice(0, 500);
    if ([...removed, ...added].some(isAround)) this._readSurroundings();
    // if an object left and was found again, the feed has only the differences
    if (removed.some((fact) => fact.predicate === RDF_TYPE && fact.value === `${HERE}DepartedObject`)) this.load(null).catch(() => {});
    this._tell("changed");
  }

  _remove({ subject, predicate, value }) {
    const field = FIELDS[predicate], one = this._at(subject);
    if (one && (!TEXTS.has(field) || one[field] === value)) delete one[field];
    return one;
  }

  _add({ subject, predicate, value }) {
    const field = FIELDS[predicate], one = this._at(subject) ?? { iri: subject };
    if (!this.has(subject) && one !== this.robot) this.objects.set(subject, one); // `_sort` decides whether it stays
    if (field === "class" && !this.kinds.has(value)) this._learn(value);
    else one[field] = TEXTS.has(field) ? value : Number(value);
    return one;
  }

  _at(iri) {
    return iri === this.robot?.iri ? this.robot : this.thingAt(iri);
  }

  /** A class that the page does not know: a new category, with which the state is read again, or none. */
  async _learn(iri) {
    if (this._others.has(iri)) return;
    this._others.add(iri);
    try {
      this._takeCategories(await this._read({ objects: "0" }));
      if (this.kinds.has(iri) && this.past === null) await this.load(null);
      if (this.kinds.has(iri)) this._tell("categories");
    } catch { this._others.delete(iri); /* the next change asks again */ }
  }

  /** Keep a changed object or thing where it belongs now: a name makes an object of a thing. */
  _sort(one) {
    const isThere = one.existence !== undefined && one.x !== undefined && one.y !== undefined;
    const kind = isThere ? this.kinds.get(one.class) : null;
    for (const [wanted, among] of Object.entries({ object: this.objects, thing: this.things })) {
      if (kind === wanted) among.set(one.iri, one);
      else among.delete(one.iri);
    }
  }

  /** Read places, doors and floor, at most once a second: they change often while a robot drives. */
  _readSurroundings() {
    this._soon ??= setTimeout(async () => {
      try {
        const state = await this._read({ objects: "0" });
        if (this.past === null) this._takeSurroundings({ ...state, robot: this.robot || state.robot });
        this._tell("changed");
      } catch { /* the next change asks again */ } finally {
        this._soon = undefined;
      }
    }, 1000);
  }

  /** A tile with its cells, the times of their last views (minutes since 1970) and the latest of them; cached by its text. */
  async _tile(row) {
    const key = `${row.cells}|${row.views || ""}`;
    if (!this._tiles.has(key)) {
      if (this._tiles.size > 4000) this._tiles.clear();
      try {
        const cells = await inflated(row.cells);
        const viewed = row.views ? new Uint32Array((await inflated(row.views)).buffer) : null;
        const latest = viewed ? viewed.reduce((a, b) => Math.max(a, b), 0) : 0;
        this._tiles.set(key, { cells, viewed, latest, side: Math.sqrt(cells.length) });
      } catch {
        this._tiles.set(key, null); // an invalid tile is not drawn
      }
    }
    const held = this._tiles.get(key);
    return held && Number.isInteger(held.side) ? { ...row, ...held } : null;
  }

  _tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
