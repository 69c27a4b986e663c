// The SPARQL console: editor, shipped questions, and the answer as a table, on the map, or as a chart.
import { enter } from "/files/entry.js";
import { all, button, byId, element, save, status } from "/files/page-elements.js";
import { QueryEditor } from "/files/query-editor.js";
import { QuestionList } from "/files/question-list.js";
import { chartOf } from "/files/result-chart.js";
import { tableOf } from "/files/result-table.js";
import { request } from "/files/server.js";
import { SparqlCompletion } from "/files/sparql-completion.js";

const SOLUTIONS = "application/sparql-results+json", TURTLE = "text/turtle";
const ROWS_AS = { CSV: ["text/csv", "csv"], TSV: ["text/tab-separated-values", "tsv"], JSON: [SOLUTIONS, "json"] };
const TRIPLES_AS = { Turtle: [TURTLE, "ttl"], "N-Triples": ["application/n-triples", "nt"], "JSON-LD": ["application/ld+json", "jsonld"] };
const SHOWN_AS = ["table", "map", "chart"];

const base = await enter(byId("console"));
const { prefixes, queries } = await (await request("/queries", { accept: "application/json" })).json();
const questions = new QuestionList(base, queries, (text) => { editor.text = text.trim(); ask(); });
const completion = new SparqlCompletion(prefixes, queries, (name) => questions.open(name));
const editor = new QueryEditor(byId("editor"), queryOfAddress() ?? byId("query").value, {
  onAsk: ask, complete: (context) => completion.complete(context),
});
let answer = null; // {columns, rows} of the last query
let asked = 0; // number of queries; only the answer to the last one is shown
let onMap = null; // created when the first answer is shown on the map

/** The query in the address of the page. It does not run by itself, since anybody may send a link. */
function queryOfAddress() {
  return new URLSearchParams(location.hash.slice(1)).get("query");
}

async function ask() {
  const number = ++asked, text = editor.text, started = performance.now();
  status("asking …");
  editor.unmark();
  history.replaceState(null, "", `#query=${encodeURIComponent(text)}`);
  try {
    const reply = await post(text, `${SOLUTIONS}, ${TURTLE};q=0.9`);
    const isTriples = !reply.headers.get("Content-Type").includes("json");
    const content = isTriples ? await reply.text() : await reply.json();
    if (number !== asked) return;
    const took = `${Math.round(performance.now() - started)} ms`;
    status(isTriples ? `triples, ${took}` : `${show(content)}, ${took}`);
    if (isTriples) showTriples(content);
    offerDownloads(text, isTriples ? TRIPLES_AS : "boolean" in content ? { JSON: ROWS_AS.JSON } : ROWS_AS);
  } catch (error) {
    if (number === asked) refuse(error.message);
  }
}

function post(text, accept) {
  return request("/sparql", { method: "POST", type: "application/sparql-query", accept, body: text });
}

/** Show why there is no answer, and mark the position of the error in the query. */
function refuse(message) {
  byId("results").classList.add("hidden");
  status(message);
  const found = /line (\d+), column (\d+)|error at (\d+):(\d+)/.exec(message);
  if (found) editor.mark(Number(found[1] ?? found[3]), Number(found[2] ?? found[4]), message);
}

/** Show rows, or yes or no; returns their number in words. */
function show({ head, results, boolean }) {
  answer = results ? { columns: head.vars, rows: results.bindings } : null;
  byId("table").replaceChildren(...(answer ? tableOf(answer, base, prefixes) : [element("p", boolean ? "yes" : "no")]));
  byId("results").classList.remove("hidden");
  showAs(answer ? SHOWN_AS.find((name) => choiceOf(name).ariaPressed === "true") : "table");
  if (!answer) return "yes or no";
  return `${answer.rows.length} row${answer.rows.length === 1 ? "" : "s"}`;
}

function showTriples(text) {
  answer = null;
  byId("table").replaceChildren(element("pre", text));
  byId("results").classList.remove("hidden");
  showAs("table");
}

function choiceOf(name) {
  return all(`[data-shown-as=${name}]`)[0];
}

/** Show the answer as a table, on the map, or as a chart; an answer without rows is always a table. */
async function showAs(name) {
  for (const one of SHOWN_AS) {
    byId(one).classList.toggle("hidden", one !== name);
    choiceOf(one).ariaPressed = String(one === name);
    choiceOf(one).disabled = !answer && one !== "table";
  }
  if (name === "chart") byId("chart").replaceChildren(chartOf(answer, byId("chart").clientWidth));
  if (name === "map") await showOnMap();
}

async function showOnMap() {
  try {
    const { ResultMap } = await import("/files/result-map.js");
    onMap ??= new ResultMap(base);
    status(`${await onMap.show(answer)} of the answer on the map`);
  } catch (error) {
    status(error.message);
  }
}

function offerDownloads(text, formats) {
  byId("downloads").replaceChildren(...Object.entries(formats).map(([name, [type, ending]]) => {
    const made = button(name, () => download(text, type, ending));
    made.ariaLabel = `download as ${name}`;
    return made;
  }));
}

async function download(text, type, ending) {
  try {
    save(`answer.${ending}`, await (await post(text, type)).blob());
  } catch (error) {
    status(error.message);
  }
}

byId("query").remove();
byId("form").addEventListener("submit", (event) => { event.preventDefault(); ask(); });
SHOWN_AS.forEach((name) => choiceOf(name).addEventListener("click", () => showAs(name)));
window.addEventListener("hashchange", () => { const text = queryOfAddress(); if (text !== null) editor.text = text; });
document.documentElement.dataset.ready = "true";
