// The data of the page: the state of the map at one moment, updated by the feed of changes if that is now.
import { followChanges } from "/files/change-feed.js";
import { isNumber, request, select, stateAt } from "/files/server.js";

const HERE = "https://w3id.org/hereabouts#";
const RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type";
const LABEL = "http://www.w3.org/2000/01/rdf-schema#label";
const UNNAMED = `${HERE}UnnamedThing`;
const MAP_GRAPH = "https://w3id.org/hereabouts/graph/map";

const CATEGORIES = `SELECT ?class ?label ?kind WHERE {
    VALUES ?kind { here:Object here:Place }
    GRAPH graph:commonsense { ?class here:isA ?kind } GRAPH graph:ontology { ?class rdfs:label ?label } }`;

/** Field of an object by predicate in the feed. */
const FIELDS = {
  [RDF_TYPE]: "class", [LABEL]: "label", [`${HERE}x`]: "x", [`${HERE}y`]: "y", [`${HERE}z`]: "z",
  [`${HERE}existence`]: "existence", [`${HERE}inPlace`]: "place", [`${HERE}lastSeen`]: "seen",
  [`${HERE}positionDeviation`]: "deviation", [`${HERE}yaw`]: "yaw", [`${HERE}extentX`]: "dx", [`${HERE}extentY`]: "dy",
  [`${HERE}extentZ`]: "dz", [`${HERE}observationCount`]: "count", [`${HERE}heading`]: "heading",
};

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

const QUAD = /^<([^>]*)> <([^>]*)> (?:<([^>]*)>|"((?:[^"\\]|\\.)*)"\S*) <([^>]*)> \.$/;

/** [subject, predicate, value] of a line of N-Quads in graph:map; null for other graphs. */
function factOf(line) {
  const found = QUAD.exec(line);
  if (!found || found[5] !== MAP_GRAPH) return null;
  const [, subject, predicate, iri, text] = found;
  return [subject, predicate, iri !== undefined ? iri : JSON.parse(`"${text.replace(/\\'/g, "'")}"`)];
}

/** A time of the map as seconds since 1970. */
export function seconds(time) {
  return Date.parse(time) / 1000;
}

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
    this.labels = new Map(); // of categories
    this._tiles = new Map(); // by the text of their cells
    this.kinds = new Map();
    this.time = null; // ISO 8601, of the shown past state
    this._others = new Set(); // classes in the feed that are no categories
    this._loading = new AbortController(); // of the last request
    this._missed = null;
  }

  /** Read the state at `at` (ISO 8601 or the number of a transaction), or the present state.
   *
   * Returns whether it is shown; false if another state was requested meanwhile. The state before stays until then. */
  async load(at = null) {
    this._loading.abort();
    const { signal } = this._loading = new AbortController();
    this._missed = []; // changes that arrive while the present is read
    try {
      if (!this.labels.size) await this._readCategories();
      const state = await stateAt(at, { signal });
      if ((state.objects ?? []).some((one) => !this.kinds.has(one.class))) await this._readCategories();
      const tiles = await this._tilesOf(state);
      if (signal.aborted) return false;
      this._show(state, tiles, at !== null);
    } catch (error) {
      if (signal.aborted) return false;
      throw error;
    } finally {
      if (!signal.aborted) this._missed = null;
    }
    return true;
  }

  _show(state, tiles, isPast) {
    this.past = isPast ? state.sequence : null;
    this.time = isPast ? state.time : null;
    this.sequence = state.sequence;
    this.last = Math.max(this.last, this.sequence);
    const byIri = (rows, more) => new Map(rows.map((one) =>
      [this.base + one.iri, { ...one, ...more, iri: this.base + one.iri, place: one.place && this.base + one.place }]));
    this.objects = byIri(state.objects, {});
    this.things = byIri(state.things, { class: UNNAMED });
    this.version++;
    this.trail = [];
    this._takeSurroundings(state, tiles);
    const missed = this._missed || [];
    this._missed = null;
    if (!isPast) missed.filter((change) => change.sequence > state.sequence).forEach((change) => this._take(change));
    this._tell("changed");
  }

  _takeSurroundings(state, tiles) {
    this._takePlaces(state.places);
    this.doors = state.doors;
    this.floor = tiles;
    this.surface = state.surface ?? 0;
    this.poses = state.poses ?? [];
    this.robot = state.robot && { ...state.robot, iri: this.fullOf(state.robot.iri) };
  }

  async _tilesOf(state) {
    return (await Promise.all(state.floor.map((tile) => this._tile(tile)))).filter(Boolean);
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
    const { sequence } = await (await request("/health", { accept: "application/json" })).json();
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

  /** A place in a sentence: "in the kitchen", "in place 3 (bedroom)". */
  inPlace(place) {
    const isKind = place.title && place.title !== place.label && !place.title.startsWith(place.label);
    return `in ${isKind ? "the " : ""}${this.nameOf(place)}`;
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

  _take(change) {
    this.last = Math.max(this.last, change.sequence);
    this._tell("transaction", change);
    this._missed?.push(change);
    if (this.past !== null) return;
    this.sequence = change.sequence;
    let around = false, back = false;
    const touched = new Set();
    for (const [lines, added] of [[change.removed, false], [change.added, true]]) {
      for (const line of lines) {
        const fact = factOf(line);
        if (!fact) continue;
        const [subject, predicate, value] = fact;
        back ||= !added && predicate === RDF_TYPE && value === `${HERE}DepartedObject`;
        const path = subject.slice(this.base.length - 1);
        if (/^\/(place|door|floor)\//.test(path) || (path === "/robot" && !this.robot)) { around = true; continue; }
        const field = FIELDS[predicate];
        if (!field) continue;
        const one = this._at(subject, added);
        if (!one) continue;
        touched.add(one);
        if (added) {
          if (field === "class" && !this.kinds.has(value)) { this._learn(value); continue; }
          one[field] = isNumber(field) ? Number(value) : value;
        } else if (String(one[field]) === value || isNumber(field)) delete one[field];
      }
    }
    for (const one of touched) {
      if (one === this.robot) this.trail.push([one.x, one.y]);
      else { this._sort(one); this.version++; }
    }
    if (this.trail.length > 2000) this.trail.splice(0, 500);
    if (around) this._readSurroundings();
    // if an object left and was found again, the feed has only the differences
    if (back) this.load(null).catch(() => {});
    this._tell("changed");
  }

  /** A class that the page does not know: a new category, with which the state is read again, or none. */
  _learn(iri) {
    if (this._others.has(iri)) return;
    this._others.add(iri);
    this._learning ??= setTimeout(async () => {
      this._learning = undefined;
      try {
        await this._readCategories();
        const found = [...this._others].filter((one) => this.kinds.has(one));
        found.forEach((one) => this._others.delete(one));
        if (found.length && this.past === null) await this.load(null);
        if (found.length) this._tell("categories");
      } catch { this._others.clear(); /* the next change asks again */ }
    }, 100);
  }

  _at(iri, make) {
    if (this.robot && iri === this.robot.iri) return this.robot;
    if (!this.thingAt(iri) && make) this.objects.set(iri, { iri });
    return this.thingAt(iri);
  }

  /** Keep a changed object or thing where it belongs now: a name makes an object of a thing. */
  _sort(one) {
    const isThere = one.existence !== undefined && one.x !== undefined && one.y !== undefined;
    const kind = isThere ? this.kinds.get(one.class) : null;
    if (kind === "object") this.objects.set(one.iri, one);
    else this.objects.delete(one.iri);
    if (kind === "thing") this.things.set(one.iri, one);
    else this.things.delete(one.iri);
  }

  /** Read places, doors and floor, at most once a second: they change often while a robot drives. */
  _readSurroundings() {
    this._soon ??= setTimeout(async () => {
      try {
        const state = await stateAt(null, { objects: false });
        const tiles = await this._tilesOf(state);
        if (this.past === null) this._takeSurroundings({ ...state, robot: this.robot || state.robot }, tiles);
        this._tell("changed");
      } catch { /* the next change asks again */ } finally {
        this._soon = undefined;
      }
    }, 1000);
  }

  _takePlaces(rows) {
    this.places = new Map();
    for (const row of rows) {
      const iri = this.base + row.iri;
      const rings = row.outline ? ringsOf(row.outline)
        : [[[row.xmin, row.ymin], [row.xmax, row.ymin], [row.xmax, row.ymax], [row.xmin, row.ymax]]];
      this.places.set(iri, { ...row, iri, rings });
    }
  }

  async _readCategories() {
    this.labels.set(UNNAMED, "unnamed thing");
    this.kinds.set(UNNAMED, "thing");
    for (const { class: iri, label, kind } of (await select(CATEGORIES)).rows) {
      this.labels.set(iri, label);
      this.kinds.set(iri, kind.endsWith("Place") ? "place" : "object");
    }
  }

  /** A tile with its cells and the times of their last views (minutes since 1970); cached by its text. */
  async _tile(row) {
    const key = `${row.cells}|${row.views || ""}`;
    if (!this._tiles.has(key)) {
      if (this._tiles.size > 4000) this._tiles.clear();
      try {
        const cells = await inflated(row.cells);
        const viewed = row.views ? new Uint32Array((await inflated(row.views)).buffer) : null;
        this._tiles.set(key, { cells, viewed, side: Math.sqrt(cells.length) });
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
