// The console: questions in words or in SPARQL, shipped ones, those of before; the answer as a table or on the map.
import { cleaned } from "/files/answer-panel.js";
import { button, byId, element, reveal, save, status } from "/files/page-elements.js";
import { QueryEditor, SparqlCompletion } from "/files/query-editor.js";
import { QuestionList } from "/files/question-list.js";
import { tableOf } from "/files/result-table.js";
import { enter, read, request } from "/files/server.js";

const SOLUTIONS = "application/sparql-results+json", TURTLE = "text/turtle";
const ROWS_AS = { CSV: ["text/csv", "csv"], TSV: ["text/tab-separated-values", "tsv"], JSON: [SOLUTIONS, "json"] };
const TRIPLES_AS = { Turtle: [TURTLE, "ttl"], "N-Triples": ["application/n-triples", "nt"], "JSON-LD": ["application/ld+json", "jsonld"] };
const IN_SPARQL = /[{}]|^\s*(#|prefix|base|select|ask|construct|describe|insert|delete)\b/i;
const KEPT = 20; // queries of before, until the tab is closed

const base = await enter(byId("console"));
const { prefixes, queries } = await read("/queries");
const questions = new QuestionList(base, queries, (text, label) => { editor.text = text.trim(); ask(label); });
const completion = new SparqlCompletion(prefixes, queries, (name) => questions.open(name));
const editor = new QueryEditor(byId("editor"), queryOfAddress() ?? byId("query").value, {
  onAsk: () => ask(), complete: (context) => completion.complete(context),
});
let answer = null; // {columns, rows} of the last query
let asked = 0; // number of queries; only the answer to the last one is shown
let onMap = null; // created when the first answer is shown on the map
/** @type {{label: string, text: string}[]} */
let before = JSON.parse(sessionStorage.getItem(`asked ${base}`) ?? "[]");

/** The query in the address of the page. It does not run by itself, since anybody may send a link. */
function queryOfAddress() {
  return new URLSearchParams(location.hash.slice(1)).get("query");
}

/** Ask the query of the editor, called so in the list of before; words are no query. */
async function ask(label = "") {
  const number = ++asked, text = editor.text, started = performance.now();
  if (!IN_SPARQL.test(text)) return askInWords(text.trim());
  status("asking …");
  if (!label) byId("said").replaceChildren();
  byId("console").classList.toggle("in-words", byId("said").childElementCount > 0);
  editor.unmark();
  history.replaceState(null, "", `#query=${encodeURIComponent(text)}`);
  try {
    const reply = await post(text, `${SOLUTIONS}, ${TURTLE};q=0.9`);
    const isTriples = !reply.headers.get("Content-Type").includes("json");
    const content = isTriples ? await reply.text() : await reply.json();
    if (number !== asked) return;
    const took = `${Math.round(performance.now() - started)} ms`;
    remember(label || /^(?!\s*#).*\S.*$/m.exec(text)?.[0] || text, text);
    status(isTriples ? `triples, ${took}` : `${show(content)}, ${took}`);
    if (isTriples) put(null, [element("pre", content)]);
    offerDownloads(text, isTriples ? TRIPLES_AS : "boolean" in content ? { JSON: ROWS_AS.JSON } : ROWS_AS);
  } catch (error) {
    if (number === asked) refuse(error.message);
  }
  return undefined;
}

/** Answer a question in words, by sentences and by the query that has its facts. */
async function askInWords(text) {
  const number = ++asked;
  status("asking …");
  try {
    const { answer: lines, query, parameters } = await read(`/find?object=${encodeURIComponent(text)}`);
    if (number !== asked) return;
    byId("said").replaceChildren(...lines.map((line) => element("p", cleaned(line))));
    reveal("results", false);
    if (query) await questions.ask(query, parameters, text);
    else { remember(text, text); status("no single query has the facts of this answer"); }
  } catch (error) {
    if (number === asked) refuse(error.message);
  }
}

/** List a query among those of before. */
function remember(label, text) {
  before = [{ label, text }, ...before.filter((one) => one.label !== label)].slice(0, KEPT);
  sessionStorage.setItem(`asked ${base}`, JSON.stringify(before));
  listBefore();
}

function listBefore() {
  byId("before").replaceChildren(...before.map((one) => element("li", "", Object.assign(button(one.label, () => {
    editor.text = one.text;
    ask(one.label === one.text ? "" : one.label);
  }), { title: one.text }))));
  reveal("asked-before", before.length > 0);
}

const post = (text, accept) => request("/sparql", { method: "POST", type: "application/sparql-query", accept, body: text });

/** Show why there is no answer, and mark the position of the error in the query. */
function refuse(message) {
  reveal("results", false);
  status(message);
  const found = /line (\d+), column (\d+)|error at (\d+):(\d+)/.exec(message);
  if (found) editor.mark(Number(found[1] ?? found[3]), Number(found[2] ?? found[4]), message);
}

/** Show rows, or yes or no; returns their number in words. */
function show({ head, results, boolean }) {
  const found = results ? { columns: head.vars, rows: results.bindings } : null, count = found?.rows.length;
  put(found, found ? tableOf(found, base, prefixes) : [element("p", boolean ? "yes" : "no")]);
  return found ? `${count} row${count === 1 ? "" : "s"}` : "yes or no";
}

/** Put an answer into its place; `found` has its columns and rows, or is null. */
function put(found, content) {
  answer = found;
  byId("table").replaceChildren(...content);
  reveal("results", true);
  turnMap(byId("on-map").ariaPressed === "true");
}

/** Show the map above the table, or not; an answer without rows has none. */
async function turnMap(isShown) {
  byId("on-map").ariaPressed = String(isShown);
  byId("on-map").disabled = !answer;
  reveal("map", isShown && answer !== null);
  if (isShown && answer) await showOnMap();
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
    return element("button", name, { type: "button", onclick: () => download(text, type, ending), ariaLabel: `download as ${name}` });
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
listBefore();
byId("in-words").addEventListener("submit", (event) => { event.preventDefault(); askInWords(byId("words").value.trim()); });
byId("form").addEventListener("submit", (event) => { event.preventDefault(); ask(); });
byId("on-map").addEventListener("click", () => turnMap(byId("on-map").ariaPressed !== "true"));
window.addEventListener("hashchange", () => { const text = queryOfAddress(); if (text !== null) editor.text = text; });
document.documentElement.dataset.ready = "true";
