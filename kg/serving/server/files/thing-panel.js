// What there is to say of one thing: beside the map, and on its own page.
import { button, byId, element, linkTo, named } from "/files/page-elements.js";
import { historyOf, percent, pictureOf, relationsOf, whyOf } from "/files/thing-details.js";
import { clock } from "/files/time-axis.js";

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
    const parts = one ? this._object(one) : place ? this._place(place, least)
      : [element("p", "Nothing is selected: ask above, or click on the map or in the list."), ...this._rooms()];
    byId("about").replaceChildren(...parts);
    this._shown(one ?? place ?? null);
    if (one || place) this._ask(iri);
  }

  /** Whether the thing has changed since its description; false right after one, and while somebody reads a source. */
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

  _rooms() {
    const entries = [...this._data.places.values()].map((room) => element("li", "", this._link(room), element("span", this._counted(room))));
    return entries.length ? [element("ul", "", ...entries)] : [];
  }

  /** The number of things in a room, in words. */
  _counted(room) {
    const { length } = this._contents(room, this._least);
    return `: ${length} ${length === 1 ? "object" : "objects"}`;
  }

  _contents(place, least) {
    return [...this._data.objects.values()].filter((one) => one.place === place.iri && one.existence >= least);
  }

  _object(one) {
    const place = this._data.places.get(one.place), where = element("span", place ? this._data.inPlace(place) : "");
    where.id = "about-where";
    const sides = [one.dx, one.dy, one.dz].map((side) => Math.round(100 * side));
    return [
      element("h2", "", ...named(this._data, one)), element("div"), // for the picture
      this._facts(one, [
        ["what", this._data.labelOf(one.class), "a"],
        ["where", where, "here:inPlace"],
        ["is it there?", sure(one.existence), "here:existence"],
        ["size", one.dx ? `${sides[0]} × ${sides[1]} cm, ${sides[2]} cm high` : "", "here:extentX"],
        ["last seen", one.seen ? element("span", clock(one.seen), element("small", one.count ? `${one.count} times in all` : "")) : "", "here:lastSeen"],
        ["position", `${one.x.toFixed(2)}, ${one.y.toFixed(2)}, ${(one.z ?? 0).toFixed(2)} m${one.deviation ? ` ± ${one.deviation.toFixed(2)} m` : ""}`, "here:x"],
      ]),
      ...this._end(one),
    ];
  }

  _place(place, least) {
    const beliefs = place.beliefs.slice(0, 6).map(([category, belief]) => element("li", `${this._data.labelOf(category)} `, sure(belief)));
    const here = this._contents(place, least);
    return [
      element("h2", this._data.nameOf(place)), element("div"),
      this._facts(place, [
        ["name", place.label !== place.title ? place.label : "", "rdfs:label"],
        ["viewed", place.share !== undefined ? `${percent(place.share)} of its floor` : "", "here:viewedShare"],
        ["last viewed", place.viewed ? clock(place.viewed) : "", "here:lastViewed"],
      ]),
      element("h3", here.length ? "In it" : "Nothing is known to be in it"), element("ul", "", ...here.map((one) => element("li", "", this._link(one)))),
      ...this._end(place), slot("kinds", "What kind of place", element("ul", "", ...beliefs)),
    ];
  }

  _end(thing) {
    const link = linkTo(thing.iri, this._data.base, "Open its page");
    link.className = "primary";
    return [element("p", "", link), slot("why", "Why the map believes it"), slot("history", "History")];
  }

  /** A list of statements [name, content, predicate], each with its source behind a line. */
  _facts(thing, rows) {
    return element("dl", "", ...rows.filter(([, content]) => content).flatMap(([name, content, predicate]) => {
      const source = element("details", "", element("summary", "why?"), element("div", "…"));
      source.className = "source";
      source.addEventListener("toggle", () => fill(source.lastElementChild, whyOf(this._data, `${this._data.pathOf(thing.iri)} ${predicate}`)), { once: true });
      return [element("dt", name), element("dd", "", content, source)];
    }));
  }

  _link(one) {
    const made = button("", () => this._choose(one.iri));
    made.className = "link";
    made.append(...named(this._data, one));
    return made;
  }

  /** Fill in the details from the server. */
  _ask(iri) {
    const data = this._data, at = (id) => byId(`about-${id}`)?.lastElementChild;
    fill(at("why"), whyOf(data, data.pathOf(iri)));
    fill(at("history"), historyOf(data, iri));
    if (!data.thingAt(iri)) return;
    const where = byId("about-where"), picture = byId("about").querySelector("h2 + div");
    relationsOf(data, iri, this._choose).then((found) => where.append(...found.flatMap((one, n) => [n || where.textContent ? ", " : "", one])), () => {});
    pictureOf(data, iri).then((found) => found && picture.replaceChildren(found), () => {});
  }
}

/** How sure something is, as a bar with words. */
function sure(share) {
  return element("span", `${percent(share)} sure `, Object.assign(element("meter"), { value: share, ariaLabel: "how sure" }));
}

/** Fill an element with what comes, or with why it does not. */
function fill(place, answer) {
  answer.then((content) => place.replaceChildren(...content), (error) => place.replaceChildren(element("p", error.message)));
}

function slot(id, title, content = element("div", "…")) {
  const made = element("details", "", element("summary", title), content);
  made.id = `about-${id}`;
  made.open = id === "history" || document.body.className !== "wide";
  return made;
}
