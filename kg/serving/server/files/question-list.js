// The shipped questions: a search by name or summary, and a form for parameters.
import { byId, element, option, status } from "/files/page-elements.js";
import { request, select } from "/files/server.js";

const OFFERED = `SELECT ?kind ?name ?iri WHERE {
  { GRAPH graph:commonsense { ?iri here:isA ?of } GRAPH graph:ontology { ?iri rdfs:label ?name }
    VALUES (?of ?kind) { (here:Object "categories") (here:Place "categories") } }
  UNION { GRAPH graph:map { ?iri a here:Place ; rdfs:label ?name } BIND("places" AS ?kind) }
  UNION { GRAPH graph:map { ?iri here:existence ?e ; rdfs:label ?name } BIND("things" AS ?kind) } } LIMIT 5000`;
const LISTS = { category: "categories", place: "places", iri: "things" };
const NUMBERS = { double: "any", integer: "1" }; // step of a field

/** Number of the typed words that the name, the summary or the examples of a question have. */
function sharedBy(words, { name, summary, asked }) {
  const text = `${name} ${summary} ${asked.join(" ")}`.toLowerCase();
  return words.filter((word) => text.includes(word)).length;
}

export class QuestionList {
  /** `questions` is the list of `/queries`; `onQuery(text, label)` is called with a query to run and what it is called. */
  constructor(base, questions, onQuery) {
    this._base = base;
    const rankOf = ({ name, asked }) => (name.startsWith("goals-") ? 2 : asked.length ? 0 : 1); // queries of the planner come last
    this._questions = [...questions].sort((a, b) => rankOf(a) - rankOf(b));
    this._onQuery = onQuery;
    this._offered = false;
    byId("question-filter").addEventListener("input", () => this._list());
    this._list();
  }

  /** Open a question: its form, or its answer if it needs no parameter. */
  open(name) {
    const question = this._questions.find((one) => one.name === name);
    byId("question").replaceChildren(element("h3", name), element("p", question.summary), this._form(question));
    if (question.parameters.some((one) => one.default === null)) byId("question").querySelector("input").focus();
    else this.ask(name, {});
    this._offer();
  }

  _list() {
    const words = (byId("question-filter").value.toLowerCase().match(/[\p{L}\p{N}-]{3,}/gu) || []).map((word) => word.replace(/s$/, ""));
    const found = this._questions.map((one) => [one, sharedBy(words, one)]).filter(([, count]) => count >= words.length / 2)
      .sort((a, b) => b[1] - a[1]).map(([one]) => one);
    byId("questions").replaceChildren(...found.map((one) => element("li", "", this._entry(one))));
  }

  /** A question as people ask it, or what it is about; its name in small print. */
  _entry({ name, summary, asked }) {
    const onclick = () => this.open(name);
    return element("button", asked[0] ?? summary, { type: "button", onclick }, element("small", asked.length ? `${name}: ${summary}` : name));
  }

  _form(question) {
    const fields = question.parameters.map((one) => this._field(one)), onsubmit = (event) => {
      event.preventDefault();
      this.ask(question.name, Object.fromEntries(new FormData(event.target)));
    };
    return element("form", "", { onsubmit }, ...fields, ...fields.length ? [element("p", "", element("button", "Ask", { type: "submit" }))] : []);
  }

  _field({ name, type, default: preset, about }) {
    const input = element("input", "", { name, value: preset ?? "", required: preset === null });
    if (NUMBERS[type]) { input.type = "number"; input.step = NUMBERS[type]; }
    if (LISTS[type]) input.setAttribute("list", LISTS[type]);
    return element("p", "", element("label", `${name} `, input), element("small", about));
  }

  /** The question as SPARQL with its values, made by the server. */
  async ask(name, values, label = [name, ...Object.values(values)].join(" ")) {
    const given = Object.entries(values).filter(([, value]) => value !== "");
    try {
      const answer = await request(`/queries/${name}?${new URLSearchParams(given)}`, { accept: "application/sparql-query" });
      this._onQuery(await answer.text(), label);
    } catch (error) {
      status(error.message);
    }
  }

  /** Suggest names of categories, places and things in the fields. */
  async _offer() {
    if (this._offered) return;
    this._offered = true;
    const options = { categories: new Map(), places: new Map(), things: new Map() };
    for (const { kind, name, iri } of await select(OFFERED).catch(() => [])) {
      const path = iri.startsWith(this._base) ? iri.slice(this._base.length) : iri;
      if (kind === "things") options.things.set(path, option(path, name));
      else options[kind].set(name, option(name, ""));
    }
    for (const [id, found] of Object.entries(options)) byId(id).replaceChildren(...found.values());
  }
}
