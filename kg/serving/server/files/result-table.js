// An answer as a table: IRIs are links to their pages, everything else is text.
import { element, linkTo } from "/files/page-elements.js";

const MAX_ROWS = 500; // in the table
const XSD = "http://www.w3.org/2001/XMLSchema#";
const NUMERIC = new Set(["integer", "decimal", "double", "float", "int", "long"].map((name) => XSD + name));

/** Whether a term of an answer is a number. */
export function isNumeric(term) {
  return term?.type === "literal" && NUMERIC.has(term.datatype) && Number.isFinite(Number(term.value));
}

/** The table of columns and rows of SPARQL JSON. `prefixes` are IRIs by name. */
export function tableOf({ columns, rows }, base, prefixes) {
  const head = element("thead", "", element("tr", "", ...columns.map((name) => element("th", name))));
  const body = rows.slice(0, MAX_ROWS).map((row) => element("tr", "", ...columns.map((name) => cellOf(row[name], base, prefixes))));
  const table = element("table", "", head, element("tbody", "", ...body));
  const left = rows.length - MAX_ROWS;
  return left > 0 ? [table, element("p", `${left} more rows are in the downloads`)] : [table];
}

function cellOf(term, base, prefixes) {
  const cell = element("td");
  if (!term) return cell;
  if (term.type === "uri") {
    const link = linkTo(term.value, base, compact(term.value, base, prefixes));
    link.title = term.value;
    cell.append(link);
    return cell;
  }
  cell.textContent = term.value;
  if (isNumeric(term)) cell.className = "number";
  else if (/#(date|dateTime)$/.test(term.datatype || "")) cell.className = "time";
  if (term["xml:lang"]) cell.append(Object.assign(element("span", ` @${term["xml:lang"]}`), { className: "dim" }));
  return cell;
}

/** A short IRI: the path for things of the map, otherwise a prefixed name if a prefix fits. */
function compact(iri, base, prefixes) {
  if (iri.startsWith(base) && iri !== base) return iri.slice(base.length);
  const fitting = Object.entries(prefixes).filter(([, start]) => iri.startsWith(start)).sort((a, b) => b[1].length - a[1].length)[0];
  return fitting ? `${fitting[0]}:${iri.slice(fitting[1].length)}` : iri;
}
