// What there is to say of one thing, beside the map and on its own page.
import { byId, chance, drawing, element, examplesOf, folded, linkButton, linkTo, named, percent, sureness } from "/files/page-elements.js";
import { read, request, select } from "/files/server.js";
import { clock, dayAndTime } from "/files/time-axis.js";

const TURNED = { on: "with … on it", inside: "with … in it" };
const ASIDES = new Set(["model", "pose", "commit", "change", "person", "rule"]); // reasons in small print
const BESIDE = 0.15 / 1.3; // of the longer side of a picture, from its edge to the box (perception/annotate.py)
const MAX_EVENTS = 12, MAX_STEPS = 6; // that are shown at once
const FINE = 400; // [px] of a picture with a box

export class ThingPanel {
  /** `choose(iri)` selects another thing; `shown(thing)` is called when one is described.
   * @param {(thing: any) => void} shown */
  constructor(data, choose, shown = () => {}) {
    this._data = data;
    this._choose = choose;
    this._shown = shown;
    this._iri = null;
    this._least = 0.5; // existence of the things that are listed
    this._described = ""; // the shown description, and its time [ms]
    this._since = 0;
  }

  /** Describe a thing; things in a place are listed from the existence `least` on. */
  show(iri, least) {
    const one = this._data.thingAt(iri), place = this._data.places.get(iri);
    [this._iri, this._least] = [iri, least];
    this._described = JSON.stringify(this._thing());
    this._since = performance.now();
    const parts = one ? this._object(one) : place ? this._place(place, least) : byId("thing") ? this._end({ iri })
      : [element("p", "Ask a question, or click on a thing or a room."), this._examples(), ...this._rooms()];
    byId("about").replaceChildren(...parts);
    this._shown(one ?? place ?? null);
    if (one || place || byId("thing")) this._ask(iri);
  }

  /** Whether the thing has changed since its description. */
  get isBehind() {
    return JSON.stringify(this._thing()) !== this._described;
  }

  get mayChange() {
    return !document.querySelector("#about .source[open]") && performance.now() >= this._since + 1000;
  }

  /** What is described: a thing, a place, or the rooms. */
  _thing() {
    return this._data.thingAt(this._iri) || this._data.places.get(this._iri) || [...this._data.places.values()].map((room) => this._counted(room));
  }

  /** Questions that this map can answer, as buttons. */
  _examples() {
    const [thing] = [...this._data.objects.values()].filter(({ existence }) => existence >= this._least), room = [...this._data.places.values()].find((one) => !/[\d(]/.test(this._data.nameOf(one)));
    const questions = [thing && `where is the ${this._data.labelOf(thing.class)}?`, room && `what is in ${this._data.theNameOf(room)}?`, "what changed?"];
    return examplesOf(thing ? questions.filter(Boolean) : []);
  }

  _rooms() {
    const entries = [...this._data.places.values()].map((room) => element("li", "", this._link(room), element("span", ` ${this._counted(room)}`)));
    return entries.length ? [element("ul", "", { className: "rooms" }, ...entries)] : [];
  }

  /** The number of things in a room, in words. */
  _counted(room) {
    const { length } = this._contents(room, this._least);
    return `${length.toLocaleString("en")} ${length === 1 ? "object" : "objects"}`;
  }

  _contents(place, least) {
    return [...this._data.objects.values()].filter((one) => one.place === place.iri && one.existence >= least);
  }

  _object(one) {
    const place = this._data.places.get(one.place), where = element("span", place ? this._data.inPlace(place) : "in no known room", { id: "about-where" });
    const sides = [one.dx, one.dy, one.dz].map((side) => Math.round(100 * side));
    return [
      element("h2", "", named(this._data, one)), element("div"), // for the picture
      this._facts(one, [
        ["what", this._data.labelOf(one.class), "a"],
        ["where", where, "here:inPlace"],
        ["is it there?", sureness(one.existence), "here:existence"],
        ["size", one.dx ? `${sides[0]} × ${sides[1]} cm, ${sides[2]} cm high` : "", "here:extentX"],
        ["last seen", one.seen ? element("span", dayAndTime(one.seen), element("small", one.count ? `${one.count} ${one.count === 1 ? "time" : "times"} in all` : "")) : "", "here:lastSeen"],
        ["position", element("span", `${one.x.toFixed(2)}, ${one.y.toFixed(2)}, ${(one.z ?? 0).toFixed(2)} m`, element("small", one.deviation ? `± ${one.deviation.toFixed(2)} m` : "")), "here:x"],
      ]),
      ...this._end(one),
    ];
  }

  _place(place, least) {
    const beliefs = place.beliefs.filter(([, belief]) => belief >= 0.005).slice(0, 6).map(([category, belief]) => element("li", `${this._data.labelOf(category)} `, sureness(belief)));
    const nameOf = (one) => this._data.nameOf(one), here = this._contents(place, least).sort((a, b) => nameOf(a).localeCompare(nameOf(b), "en", { numeric: true }));
    return [
      element("h2", nameOf(place)), element("div"),
      this._facts(place, [
        ["name", place.label !== place.title ? place.label : "", "rdfs:label"],
        ["viewed", place.share !== undefined ? `${percent(place.share)} of its floor` : "", "here:viewedShare"],
        ["last viewed", place.viewed ? dayAndTime(place.viewed) : "", "here:lastViewed"],
      ]),
      ...beliefs.length ? [element("h3", "What kind of place"), element("ul", "", ...beliefs)] : [],
      element("h3", here.length ? "In it" : "Nothing is known to be in it"), element("ul", "", ...here.map((one) => element("li", "", this._link(one)))),
      ...this._end(place),
    ];
  }

  _end(thing) {
    const link = Object.assign(linkTo(thing.iri, this._data.base, "Open its page"), { className: "primary" });
    return [element("p", "", link), slot("why", "Why the map believes it"), slot("history", "History")];
  }

  /** A list of statements [name, content, predicate], each with its source behind a line. */
  _facts(thing, rows) {
    return element("dl", "", ...rows.filter(([, content]) => content).flatMap(([name, content, predicate]) => {
      const source = element("details", "", { className: "source" }, element("summary", "why?"), element("div", "…"));
      source.addEventListener("toggle", () => fill(source.lastElementChild, whyOf(this._data, `${this._data.pathOf(thing.iri)} ${predicate}`)), { once: true });
      return [element("dt", name), element("dd", "", content, source)];
    }));
  }

  _link(one) {
    return linkButton(() => this._choose(one.iri), named(this._data, one));
  }

  /** Fill in the details from the server. */
  _ask(iri) {
    const data = this._data, at = (id) => byId(`about-${id}`)?.lastElementChild;
    fill(at("why"), whyOf(data, data.pathOf(iri)));
    fill(at("history"), historyOf(data, iri));
    const where = byId("about-where"), picture = byId("picture") ?? byId("about").querySelector("h2 + div");
    pictureOf(data, iri).then((found) => found && picture.replaceChildren(found), () => {});
    if (where) relationsOf(data, iri, this._choose).then((phrases) => where.append(...phrases.flatMap((one) => [", ", one])), () => {});
  }
}

/** Fill an element with what comes, or with why it does not. */
function fill(place, answer) {
  answer.then((content) => place.replaceChildren(...content), (error) => place.replaceChildren(element("p", error.message)));
}

function slot(id, title) {
  const open = id === "history" || document.body.className !== "wide";
  return element("details", "", { id: `about-${id}`, open }, element("summary", title), element("div", "…"));
}

/** What it is on, in or beside, and what is on or in it: phrases with links, the surest first. */
async function relationsOf(data, iri, choose) {
  const rows = await select(`SELECT ?kind ?other ?chance ?turned WHERE { GRAPH graph:map {
      { <${iri}> here:hasRelation ?r . ?r here:relatedTo ?other . BIND(false AS ?turned) }
      UNION { ?other here:hasRelation ?r . ?r here:relatedTo <${iri}> . BIND(true AS ?turned) }
      ?r here:ofRelation ?kind ; here:relationProbability ?chance } } ORDER BY DESC(?chance) ?other LIMIT 12`, data.past);
  const found = new Map(); // words before and after -> IRI -> chance
  for (const { kind: relation, other, chance: share, turned } of rows) {
    const kind = relation.replace(/.*#/, ""), words = (turned === "true" && TURNED[kind]) || `${kind} …`, others = found.get(words) ?? new Map();
    if (data.objects.has(other) && !others.has(other)) found.set(words, others.set(other, share));
  }
  return [...found].map(([words, others]) => {
    const [before, after] = words.split("…"), names = [...others.keys()].map((other) => data.partsOf(data.objects.get(other))[0]);
    return element("span", before, ...[...others].flatMap(([other, share], n) => {
      const one = data.objects.get(other), isOnly = names.filter((name) => name === names[n]).length === 1; // of its name; others have their numbers
      const link = linkButton(() => choose(other), isOnly ? named(data, one) : data.nameOf(one), { title: `${percent(Number(share))} sure` });
      return [n ? (n === names.length - 1 ? " and " : ", ") : "", isOnly ? "the " : "", link];
    }), after);
  });
}

/** The explanation as steps, of a thing or of one of its facts; only of the present. */
async function whyOf(data, what) {
  if (data.past !== null) return [element("p", "Reasons are told for the present: choose now.")];
  const reasons = await read(`/why?what=${encodeURIComponent(what)}`);
  const facts = reasons.flatMap((one) => (one.kind === "thing" ? one.because.filter(({ kind }) => !ASIDES.has(kind)) : [one])); // which thing it is, the page says already
  return [stepsOf(data, facts, data.fullOf(what.split(" ")[0]))];
}

/** Steps, each with where and when it was made in small print; what was seen has its picture. */
function stepsOf(data, reasons, iri) {
  const surety = ({ iri: other }) => data.thingAt(other)?.existence ?? 1;
  return folded("ol", [...reasons].sort((a, b) => surety(b) - surety(a)), MAX_STEPS, (reason) => {
    const { text, because } = reason, made = element("li", "", element("span", plain(text)), element("small", asidesOf(reason).map(plain).join("; ")));
    const steps = because.filter(({ kind }) => !ASIDES.has(kind));
    if (reason.kind === "observation") pictureOf(data, iri).then((picture) => picture && made.prepend(boxed(picture)), () => {});
    if (steps.length) made.append(stepsOf(data, steps, iri));
    return made;
  });
}

const asidesOf = ({ because }) => because.filter(({ kind }) => ASIDES.has(kind)).flatMap((one) => [one.text, ...asidesOf(one)]);

/** A picture with the box in which the thing was seen: the picture has a margin around it. */
function boxed(picture) {
  const grown = FINE / Math.max(picture.width, picture.height), [width, height] = [picture.width * grown, picture.height * grown];
  const c = drawing(width, height), inset = BESIDE * FINE;
  c.drawImage(picture, 0, 0, width, height);
  for (const [colour, wide] of [["#fff", FINE / 50], ["#d55e00", FINE / 100]]) {
    Object.assign(c, { strokeStyle: colour, lineWidth: wide });
    c.strokeRect(inset, inset, width - 2 * inset, height - 2 * inset);
  }
  return Object.assign(c.canvas, { role: "img", ariaLabel: `${picture.ariaLabel}, in its box` });
}

/** A line of an explanation in the words of the page: clock times, percentages. */
function plain(text) {
  return text.replace(/there with ((?:over |under )?[\d.]+ %)/g, "$1 sure").replace(/: box [\d .-]+ px, score ([\d.]+)/, (_, score) => `, ${percent(score)} sure`)
    .replace(/, existence ([\d.]+)$/, (_, sure) => `, ${chance(Number(sure))} sure`).replace(/: box .*/, "")
    .replace(/([\d.]+) x ([\d.]+) x ([\d.]+) m/g, (_, ...sides) => `${sides.slice(0, 3).map((side) => Math.round(100 * side)).join(" × ")} cm`)
    .replace(/heading (-?[\d.]+) rad/, (_, angle) => `looking ${Math.round(angle * 180 / Math.PI)}°`)
    .replace(/^transaction #\d+ at (\S+Z)(?:: frame \((.*)\/(.*)\))?/, (_, time, recording, frame) => `written at ${time}${frame ? `, from ${frame} of ${recording}` : ""}`)
    .replace(/\d{4}-\d\d-\d\dT[\d:.]+Z/g, (time) => clock(time));
}

/** The changes of one moment as a sentence. */
function sentenceOf(told) {
  const changes = told.filter((text, n) => !n || !text.startsWith("new: ")).map((text) => text.replace(/^new: .*/, "appeared").replace(/^(moved .*), at /, "$1 to ").replace(/^(stopped|found|given up)$/, "ended: $&"));
  return `It ${changes.join(", ").replace(/^(an?|in|on|inside|at|called|no longer) /, "is $&").replace(/^there /, "is there, $&").replace(/^removed/, "was $&").replace(/^appeared, (?=in|at|on)/, "appeared ")}`;
}

/** Events, where nobody changed the same again the last of them, with the number of those before. */
function distinct(events) {
  const kept = [], kindOf = ({ by, told }) => by || told.map((text) => text.replace(/^an? .*/, "a").replace(/ .*/, "")).join();
  for (const event of events) {
    const by = event.by?.replace(/^search.*/, ""), isAlone = by || event.told.length < 2; // a search is no person
    const now = { ...event, by, told: event.told.filter((text) => isAlone || !text.startsWith("called ")), more: 0 }, last = kept.at(-1);
    if (last && !by && kindOf(last) === kindOf(now)) Object.assign(now, { more: kept.pop().more + 1 });
    kept.push(now);
  }
  return kept;
}

/** What happened to it, as `/log` tells it, the last first. */
async function historyOf(data, iri) {
  const log = await read(`/log?iri=${encodeURIComponent(data.pathOf(iri))}&told=1&last=200`);
  const events = distinct(log.filter(({ sequence }) => data.past === null || sequence <= data.past)).reverse();
  return [folded("ul", events, MAX_EVENTS, ({ time, by, cause, told, more }) => {
    const words = plain(sentenceOf(told)) + (by ? ` (${by})` : "") + (more ? `, after ${more} such ${more === 1 ? "change" : "changes"}` : "");
    return element("li", "", { title: cause }, element("small", clock(time)), words);
  })];
}

/** The picture of an object's best observation, drawn; null where none is kept. */
export async function pictureOf(data, iri) {
  const number = /^object\/(\d+)$/.exec(data.pathOf(iri));
  if (!number || data.past !== null) return null; // a picture of the present would not belong here
  const answer = await request(`/pictures/${number[1]}`, { accept: "image/jpeg" }).catch(() => null);
  const image = answer?.status === 200 && await createImageBitmap(await answer.blob()).catch(() => null);
  if (!image) return null;
  const c = drawing(image.width, image.height);
  c.drawImage(image, 0, 0);
  return Object.assign(c.canvas, { role: "img", ariaLabel: `${data.nameAt(iri)} as it was seen best` });
}
