// The answer to a question: sentences with links, the things that it is about, and where to look for what is sought.
import { byId, chance, element, examplesOf, folded, linkButton, named, percent, reveal, sureness } from "/files/page-elements.js";
import { read } from "/files/server.js";
import { pictureOf } from "/files/thing-panel.js";
import { clock } from "/files/time-axis.js";

const MAX_STEPS = 12, MAX_THINGS = 30, MANY = 3000; // that are listed; with more in the map a plan takes long
const SURE = 0.5; // existence of the things that are ringed, beside the best one
const COMMAND = /: `hereabouts [^`]*`/g, CHANCE = / \((?:[^()]* sure|still there with [^()]*)\)/g; // told otherwise on the page
const MOMENT = /\b(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d(?::\d\d(?:\.\d+)?)?)(?:Z| UTC)?/g; // of UTC
const EXAMPLES = /^(.+); questions.* that are: (.+)$/s; // of a refusal
const HEAD = /^(.{3,70}?): (?=\D)(.+)$/s;

/** A line of an answer without what the page tells otherwise. */
export const cleaned = (line) => line.replace(COMMAND, "").replace(CHANCE, "").replace(MOMENT, (_, day, time) => clock(`${day}T${time}Z`));

export class AnswerPanel {
  /** `found(iri)` goes to what was found, `choose(iri)` selects a thing, `asked()` brings the panel to the front. */
  constructor(data, view, { found, choose, asked }) {
    this._data = data;
    this._view = view;
    this._found = found;
    this._choose = choose;
    this._toFront = asked;
    this._asked = new AbortController(); // of the last request
    this.wanted = ""; // of the shown answer
    this._answer = null;
    this._isWay = false; // whether the way of the plan is drawn
    this._isLost = false; // whether the server did not answer
    data.addEventListener("changed", () => this._draw());
    data.addEventListener("on", () => { if (this._isLost) this.find(this.wanted, { quiet: true }); });
    byId("find").addEventListener("submit", (event) => { event.preventDefault(); this.find(byId("wanted").value.trim()); });
  }

  /** Ask, or end that (""); `quiet`: without a move to what is found. */
  async find(wanted, { quiet = false } = {}) {
    this.wanted = byId("wanted").value = wanted;
    this._isLost = false;
    this._asked.abort(); // a new request cancels the one before
    const { signal } = this._asked = new AbortController();
    this._show(null); // an old answer is none to this question
    if (!wanted) return;
    this._say(this._data.objects.size > MANY ? "planning; among so many things this takes up to a minute …" : "planning …");
    try {
      const { about = [], known = [], steps = [], understood = [], ...rest } = await read(`/find?object=${encodeURIComponent(wanted)}`, { signal });
      this._show({ ...rest, known, steps, understood, about: about.map((one) => ({ ...one, iri: this._data.fullOf(one.iri) })) });
      if (!quiet) this._found(this._answer.known[0]?.iri ?? null);
    } catch (error) {
      if (signal.aborted) return;
      this._isLost = !error.status;
      this._say(error.message);
    }
  }

  _say(text) {
    const [, reason, questions] = EXAMPLES.exec(text) ?? [null, text, ""];
    byId("plan").replaceChildren(element("p", reason), ...(questions ? [element("p", "These would work:"), examplesOf(questions.split(" / "))] : []));
    this._toFront();
  }

  _show(answer) {
    this._answer = answer;
    this._isWay = Boolean(answer?.steps.length) && !answer.known.some((one) => one.still_there >= 0.5);
    byId("plan").replaceChildren(...(answer ? this._told(answer) : []));
    if (answer) this._toFront();
    this._draw();
  }

  /** Draw the way, and rings around what the answer is about; not in the past. */
  _draw() {
    const answer = this._data.past === null ? this._answer : null;
    this._view.plan = this._isWay ? answer : null;
    const iris = answer ? [...answer.known.slice(0, 1), ...[...answer.known, ...answer.about].filter(({ iri }) => !(this._data.thingAt(iri)?.existence < SURE))].map((one) => one.iri) : [];
    this._view.highlights = { iris: new Set(iris), points: [], rings: [] };
    reveal("plan", this._data.past === null);
    this._view.draw();
  }

  _told(answer) {
    const [first = "", ...rest] = answer.answer.map(cleaned);
    const [, head, tail] = HEAD.exec(first) ?? [null, first, ""], best = answer.known[0], picture = element("div");
    return [
      element("h2", "", ...this._linked(head, answer.about)), picture,
      ...(best ? this._surely(best, picture) : []),
      ...[tail, ...rest, ...answer.understood].filter(Boolean).map((line) => element("p", "", ...this._linked(line, answer.about))),
      this._things(answer), ...(answer.steps.length ? this._looks(answer) : []),
    ];
  }

  /** How sure it is that the best thing is still there, and its picture. */
  _surely({ iri, still_there: sure }, frame) {
    pictureOf(this._data, iri).then((picture) => picture && frame.replaceChildren(picture), () => {});
    return [element("p", "", sureness(sure, "sure that it is still there"))];
  }

  /** A sentence with links where it names things. */
  _linked(line, about) {
    const names = about.filter(({ name }) => name).sort((a, b) => b.name.length - a.name.length);
    const texts = names.map(({ name }) => name.replace(/[\\^$.*+?()[\]{}|/-]/g, "\\$&")).join("|");
    const pattern = new RegExp(`(?<![\\p{L}\\p{N}])(${texts})(?![\\p{L}\\p{N}])`, "gu");
    return names.length ? line.split(pattern).flatMap((part, n, parts) => (n % 2 ? [this._article(part, parts[n - 1]), this._link(names.find(({ name }) => name === part).iri, part)] : [part])) : [line];
  }

  /** The article of a name in a sentence: "the remote" for "remote 17", whose number is hidden. */
  _article(name, before) {
    return !/^\p{Ll}.* \d+$/u.test(name) || /\b(the|an?)\s$/i.test(before) ? "" : before ? "the " : "The ";
  }

  _link(iri, text) {
    const one = this._data.thingAt(iri), hasName = one && (!text || text === one.label);
    return linkButton(() => this._choose(iri), hasName ? named(this._data, one) : text || this._data.nameAt(iri));
  }

  /** What the answer is about and its sentences do not name. */
  _things({ about, known }) {
    const told = new Set(about.filter(({ name }) => name).map(({ iri }) => iri)), [room, ...others] = [...told].filter((iri) => this._data.places.has(iri));
    const iris = [...new Set([...known, ...about].map(({ iri }) => iri))].filter((iri) => !told.has(iri) && this._data.has(iri));
    return folded("ul", iris, MAX_THINGS, (iri) => this._entry(iri, others.length ? "" : room));
  }

  /** A thing with its place, unless that is the only one that the sentences tell. */
  _entry(iri, room) {
    const one = this._data.thingAt(iri), isKnown = one?.place === room, told = one ? ` ${isKnown ? `${chance(one.existence)} sure` : this._data.whereabouts(one)}` : "";
    return element("li", "", this._link(iri, ""), element("span", told, { className: "dim" }));
  }

  _looks(plan) {
    const rest = plan.steps.length - plan.worthwhile, looks = element("details", "", element("summary", "Where to look"),
      element("p", `It is on this floor with ${percent(plan.present)}; these looks find it with ${percent(plan.probability)}.`),
      element("ol", "", ...this._steps(plan)),
      ...rest ? [element("p", `${rest} more ${rest === 1 ? "look gains" : "looks gain"} little for ${rest === 1 ? "its" : "their"} time`)] : [],
      { open: this._isWay, ontoggle: () => { this._isWay = looks.open; this._draw(); } });
    return [element("p", "", element("button", "Show the way", { type: "button", className: "primary", onclick: () => { looks.open = !looks.open; } })), looks];
  }

  _steps(plan) {
    const given = new Set(); // reasons that were listed already
    return plan.steps.slice(0, Math.min(plan.worthwhile, MAX_STEPS)).map((step, n) => {
      const reason = step.why.slice(0, 1).find((one) => !given.has(one.iri));
      if (reason) given.add(reason.iri);
      return element("li", "", linkButton(() => this._view.goTo(step.x, step.y), `look ${n + 1}`), ` after ${Math.round(step.seconds)} s, finds it with ${percent(step.probability)}`,
        element("small", reason ? reason.facts.slice(0, 2).join("; ") : ""));
    });
  }
}
