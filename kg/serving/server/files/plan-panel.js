// The search: the wanted objects, the plan to find them, and its reasons.
import { button, byId, element } from "/files/page-elements.js";
import { request } from "/files/server.js";

const MAX_STEPS = 12; // of a plan that are listed
const KNOWN = 4;

export class PlanPanel {
  constructor(data, view, choose) {
    this._data = data;
    this._view = view;
    this._choose = choose;
    this._asked = new AbortController(); // of the last request
    this.wanted = ""; // of the shown plan
    this._plan = null;
    data.addEventListener("changed", () => this._draw());
    byId("find").addEventListener("submit", (event) => { event.preventDefault(); this.find(byId("wanted").value.trim()); });
  }

  /** Plan a search, or end it (""); `quiet`: without a move to what is found. */
  async find(wanted, { quiet = false } = {}) {
    this.wanted = byId("wanted").value = wanted;
    this._asked.abort(); // a new request cancels the one before
    const { signal } = this._asked = new AbortController();
    this._show(null); // an old plan is no answer to this search
    if (!wanted) return;
    byId("plan").replaceChildren(element("p", "planning …"));
    try {
      const answer = await request(`/find?object=${encodeURIComponent(wanted)}`, { accept: "application/json", signal });
      const plan = await answer.json();
      this._show(plan);
      if (plan.known.length && !quiet) this._choose(plan.known[0].iri);
    } catch (error) {
      if (!signal.aborted) byId("plan").replaceChildren(element("p", error.message));
    }
  }

  _show(plan) {
    this._plan = plan;
    byId("plan").replaceChildren(...(plan ? this._told(plan) : []));
    this._draw();
  }

  /** Draw the plan, and rings around what is known; not in the past, since it is made for the present. */
  _draw() {
    const plan = this._data.past === null ? this._plan : null;
    this._view.plan = plan;
    this._view.highlights = { iris: new Set(plan?.known.map((one) => one.iri)), points: [], rings: [] };
    byId("plan").classList.toggle("hidden", this._data.past !== null);
    this._view.draw();
  }

  _told(plan) {
    const known = plan.known.slice(0, KNOWN).map((one) => element("li", "", button(one.label, () => this._choose(one.iri))));
    return [
      ...[...plan.understood, ...plan.answer].map((sentence) => element("p", sentence)), element("ul", "", ...known),
      ...plan.steps.length ? this._looks(plan) : [],
    ];
  }

  _looks(plan) {
    const rest = plan.steps.length - plan.worthwhile;
    return [
      element("h2", "Where to look"),
      element("p", `on this floor with ${plan.present.toFixed(2)}; the plan finds it with ${plan.probability.toFixed(2)}`),
      element("ol", "", ...this._steps(plan)),
      ...rest ? [element("p", `${rest} more ${rest === 1 ? "look gains" : "looks gain"} little for ${rest === 1 ? "its" : "their"} time`)] : [],
    ];
  }

  _steps(plan) {
    const given = new Set(); // reasons that were listed already
    return plan.steps.slice(0, Math.min(plan.worthwhile, MAX_STEPS)).map((step, n) => {
      const reason = step.why.slice(0, 1).find((one) => !given.has(one.iri));
      if (reason) given.add(reason.iri);
      return element("li", "", button(`look ${n + 1}`, () => this._view.goTo(step.x, step.y)),
        ` by ${Math.round(step.seconds)} s, finds it with ${step.probability.toFixed(3)}`,
        element("small", reason ? reason.facts.slice(0, 2).join("; ") : ""));
    });
  }
}
