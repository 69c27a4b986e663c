// An answer as a table: IRIs are links to their pages, everything else is text.
import { button, element, linkTo } from "/files/page-elements.js";
import { clock } from "/files/time-axis.js";

const MAX_ROWS = 500; // in the table
const XSD = "http://www.w3.org/2001/XMLSchema#";
const NUMERIC = new Set(["integer", "decimal", "double", "float", "int", "long"].map((name) => XSD + name));

/** Whether a term of an answer is a number. */
export function isNumeric(term) {
  return term?.type === "literal" && NUMERIC.has(term.datatype) && Number.isFinite(Number(term.value));
}

/** The table of columns and rows of SPARQL JSON; a click on a column's name sorts by it. `prefixes` are IRIs by name. */
export function tableOf({ columns, rows }, base, prefixes) {
  const head = element("tr"), body = element("tbody"), left = rows.length - MAX_ROWS;
  const draw = (by, down) => {
    const sorted = by ? [...rows].sort((a, b) => compared(a[by], b[by], down ? -1 : 1)) : rows, top = by ? Math.max(...rows.map((row) => sizeOf(row[by]))) : 0;
    head.replaceChildren(...columns.map((name) => {
      const cell = element("th", "", button(name, () => draw(name, name === by && !down)));
      if (rows.some((row) => isNumeric(row[name]))) cell.className = "number";
      if (name === by) cell.ariaSort = down ? "descending" : "ascending";
      return cell;
    }));
    body.replaceChildren(...sorted.slice(0, MAX_ROWS).map((row) => element("tr", "", ...columns.map((name) => cellOf(row[name], base, prefixes, name === by && top)))));
  };
  draw(null, false);
  const table = element("table", "", element("thead", "", head), body);
  return left > 0 ? [table, element("p", `${left} more rows are in the downloads; sorting counts them`)] : [table];
}

/** The order of two terms: numbers by value, others as people sort names; what is missing comes last. */
function compared(a, b, sign) {
  if (!a || !b) return Number(!a) - Number(!b);
  return sign * (isNumeric(a) && isNumeric(b) ? Number(a.value) - Number(b.value) : a.value.localeCompare(b.value, "en", { numeric: true }));
}

const sizeOf = (term) => (isNumeric(term) ? Math.abs(Number(term.value)) : 0);

/** A cell; with a bar for its number where the table is sorted by its column, whose greatest number is `top`. */
function cellOf(term, base, prefixes, top) {
  const cell = element("td");
  if (!term) return cell;
  if (term.type === "uri") {
    cell.append(Object.assign(linkTo(term.value, base, compact(term.value, base, prefixes)), { title: term.value }));
    return cell;
  }
  cell.textContent = term.value;
  if (isNumeric(term)) cell.className = "number";
  if (isNumeric(term) && top) cell.style.background = `linear-gradient(to left, var(--selection) ${100 * sizeOf(term) / top}%, transparent 0)`;
  if (/#(date|dateTime)$/.test(term.datatype || "")) cell.className = "time";
  if (/#dateTime$/.test(term.datatype || "") && Date.parse(term.value)) Object.assign(cell, { textContent: clock(term.value), title: term.value });
  if (term["xml:lang"]) cell.append(element("span", ` @${term["xml:lang"]}`, { className: "dim" }));
  return cell;
}

/** A short IRI: the path for things of the map, otherwise a prefixed name if a prefix fits. */
export function compact(iri, base, prefixes) {
  if (iri.startsWith(base) && iri !== base) return iri.slice(base.length);
  const fitting = Object.entries(prefixes).filter(([, start]) => iri.startsWith(start)).sort((a, b) => b[1].length - a[1].length)[0];
  return fitting ? `${fitting[0]}:${iri.slice(fitting[1].length)}` : iri;
}
