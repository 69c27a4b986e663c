// Facts of the selected thing: those of the map at once, then details from the server.
import { button, byId, element, linkTo } from "/files/page-elements.js";
import { historyOf, pictureOf, relationsOf, whyOf } from "/files/thing-details.js";

const NEAREST = 5;

export class ThingPanel {
  /** `choose(iri)` selects another thing; `corrections(thing)` returns a form or null. */
  constructor(data, choose, corrections) {
    this._data = data;
    this._choose = choose;
    this._corrections = corrections;
    this._iri = null;
    this._described = ""; // the shown description, and its time [ms]
    this._since = 0;
  }

  /** Describe a thing; things in a place are listed from the existence `least` on. */
  show(iri, least) {
    const one = this._data.thingAt(iri), place = this._data.places.get(iri);
    this._iri = iri;
    this._described = JSON.stringify(this._thing());
    this._since = performance.now();
    const parts = one ? this._object(one) : place ? this._place(place, least)
      : [element("p", "Nothing is selected: click on the map or in the list.")];
    byId("about").replaceChildren(...parts);
    if (one || place) this._ask(iri);
  }

  /** Whether the thing has changed since its description; false right after one, and while somebody types. */
  get isBehind() {
    return this._iri !== null && JSON.stringify(this._thing()) !== this._described;
  }

  get mayChange() {
    return !document.activeElement?.matches("#about input") && performance.now() >= this._since + 1000;
  }

  _thing() {
    return this._data.thingAt(this._iri) || this._data.places.get(this._iri) || null;
  }

  _object(one) {
    const place = this._data.places.get(one.place);
    return [
      element("h2", this._data.nameOf(one)),
      element("div"), // for the picture
      facts([
        ["category", this._data.labelOf(one.class)],
        ["where", place ? `in ${this._data.placeName(place)}` : ""],
        ["existence", one.existence.toFixed(2)],
        ["position", `${one.x.toFixed(2)}, ${one.y.toFixed(2)}, ${(one.z ?? 0).toFixed(2)} m${one.deviation ? ` ± ${one.deviation.toFixed(2)} m` : ""}`],
        ["size", one.dx ? `${one.dx.toFixed(2)} x ${one.dy.toFixed(2)} x ${one.dz.toFixed(2)} m${one.yaw ? `, turned by ${Math.round(one.yaw * 180 / Math.PI)}°` : ""}` : ""],
        ["last seen", one.seen ? `${moment(one.seen)}, ${this._data.ago(one.seen)} before the last view of the map` : ""],
        ["seen", one.count ? `${one.count} times` : ""],
      ]),
      element("h3", "Near it"), element("ul", "", ...this._near(one)), slot("relations", "On, in and beside"),
      ...this._end(one),
    ];
  }

  _near(one) {
    return [...this._data.objects.values()].filter((other) => other !== one && other.existence >= 0.5)
      .map((other) => [Math.hypot(other.x - one.x, other.y - one.y), other])
      .sort((a, b) => a[0] - b[0]).slice(0, NEAREST)
      .map(([distance, other]) => element("li", "", this._link(other), ` ${distance.toFixed(2)} m`));
  }

  _place(place, least) {
    const beliefs = place.beliefs.slice(0, 6).map(([category, belief]) => {
      const bar = element("meter");
      bar.value = belief;
      return element("li", `${this._data.labelOf(category)} ${belief.toFixed(2)} `, bar);
    });
    const here = [...this._data.objects.values()].filter((one) => one.place === place.iri && one.existence >= least);
    return [
      element("h2", this._data.placeName(place)),
      facts([
        ["viewed", place.share !== undefined ? `${Math.round(place.share * 100)} % of its floor` : ""],
        ["last viewed", place.viewed ? moment(place.viewed) : ""],
      ]),
      element("h3", "Probable categories"), element("ul", "", ...beliefs),
      element("h3", "Objects in it"), element("ul", "", ...here.map((one) => element("li", "", this._link(one)))),
      ...this._end(place),
    ];
  }

  _end(thing) {
    const form = this._corrections(thing), link = linkTo(thing.iri, this._data.base, "all its facts, as a page and as data");
    return [slot("why", "Why"), slot("history", "History"), ...(form ? [form] : []), element("p", "", link)];
  }

  _link(one) {
    return button(this._data.nameOf(one), () => this._choose(one.iri));
  }

  /** Fill in the details from the server. */
  _ask(iri) {
    const fill = (id, answer) => {
      const put = (...content) => {
        const place = byId(`about-${id}`)?.lastElementChild;
        if (place && this._iri === iri) place.replaceChildren(...content);
      };
      answer.then((content) => put(...content), (error) => put(element("p", error.message)));
    };
    if (this._data.thingAt(iri)) {
      fill("relations", relationsOf(this._data, iri, this._choose));
      this._showPicture(iri);
    }
    fill("why", whyOf(this._data, iri));
    fill("history", historyOf(this._data, iri));
  }

  async _showPicture(iri) {
    const picture = await pictureOf(this._data, iri);
    if (picture && this._iri === iri) byId("about").querySelector("h2 + div")?.replaceChildren(picture);
  }
}

function moment(time) {
  return time.replace("T", " ").replace("Z", " UTC");
}

function facts(pairs) {
  return element("dl", "", ...pairs.filter(([, value]) => value).flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
}

function slot(id, title) {
  const made = element("details", "", element("summary", title), element("div", "…"));
  made.id = `about-${id}`;
  made.open = id !== "why";
  return made;
}
