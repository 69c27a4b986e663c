"use strict";
const byId = (id) => document.getElementById(id);
const SHOWN = 500;

function cell(row, text, tag = "td") {
  const made = document.createElement(tag);
  made.textContent = text;
  row.append(made);
}

function showTable(found) {
  const table = byId("answer");
  const columns = found.head.vars || ["answer"];
  const rows = found.results ? found.results.bindings : [{ answer: { value: String(found.boolean) } }];
  table.replaceChildren();
  const head = table.createTHead().insertRow();
  columns.forEach((name) => cell(head, name, "th"));
  const body = table.createTBody();
  rows.slice(0, SHOWN).forEach((binding) => {
    const row = body.insertRow();
    columns.forEach((name) => cell(row, binding[name] ? binding[name].value : ""));
  });
  table.classList.remove("hidden");
  const more = rows.length > SHOWN ? `, the first ${SHOWN} shown` : "";
  return `${rows.length} row${rows.length === 1 ? "" : "s"}${more}`;
}

async function ask(event) {
  if (event) event.preventDefault();
  const outcome = byId("outcome");
  ["answer", "text"].forEach((id) => byId(id).classList.add("hidden"));
  outcome.textContent = "asking …";
  const started = performance.now();
  try {
    const answer = await fetch("/sparql", {
      method: "POST",
      headers: { "Content-Type": "application/sparql-query", Accept: "application/sparql-results+json, text/turtle;q=0.9" },
      body: byId("query").value,
    });
    const took = `${Math.round(performance.now() - started)} ms`;
    const kind = answer.headers.get("Content-Type") || "";
    if (answer.ok && kind.includes("json")) {
      outcome.textContent = `${showTable(await answer.json())}, ${took}`;
      return;
    }
    byId("text").textContent = await answer.text();
    byId("text").classList.remove("hidden");
    outcome.textContent = answer.ok ? took : `refused (${answer.status})`;
  } catch (error) {
    outcome.textContent = `no answer: ${error.message}`;
  }
}

byId("form").addEventListener("submit", ask);
byId("query").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) ask(event);
});
byId("questions").addEventListener("change", (event) => {
  if (event.target.value) {
    byId("query").value = event.target.value;
    ask();
  }
});
