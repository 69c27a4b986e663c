// An answer as a chart: the first column of numbers as bars, or as a line over a column of numbers or times before it.
import { element } from "/files/page-elements.js";
import { isNumeric } from "/files/result-table.js";

const SVG = "http://www.w3.org/2000/svg";
const BARS = 60;
const ROW = 22, HEIGHT = 300, MARGIN = 70, RIGHT = 70; // [px]

/** A chart of columns and rows of SPARQL JSON, `width` pixels wide; a sentence if there are no numbers. */
export function chartOf({ columns, rows }, width) {
  const numeric = columns.filter((name) => rows.some((row) => row[name]) && rows.every((row) => !row[name] || isNumeric(row[name])));
  if (!numeric.length) return element("p", "a chart needs a column of numbers, such as a COUNT");
  const over = columns.find((name) => !numeric.includes(name) && rows.every((row) => isTime(row[name])))
    || (numeric.length > 1 && numeric.length === columns.length ? numeric[0] : null);
  const value = numeric.find((name) => name !== over);
  return over ? lineOf(rows, over, value, width) : barsOf(rows, columns.find((name) => !numeric.includes(name)), value, width);
}

function isTime(term) {
  return term?.type === "literal" && /dateTime$|date$/.test(term.datatype || "") && !Number.isNaN(Date.parse(term.value));
}

function drawn(name, attributes, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

function picture(width, height, label, parts) {
  const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, class: "chart", role: "img", "aria-label": label });
  svg.append(...parts);
  return svg;
}

function barsOf(rows, names, value, width) {
  const shown = rows.filter((row) => row[value]).slice(0, BARS);
  const numbers = shown.map((row) => Number(row[value].value));
  const low = Math.min(0, ...numbers), span = Math.max(0, ...numbers) - low || 1;
  const left = Math.min(220, width * 0.35), letters = Math.floor(left / 8);
  const scale = (width - left - RIGHT) / span, zero = left - low * scale;
  const parts = shown.flatMap((row, n) => {
    const y = n * ROW, long = Math.abs(numbers[n]) * scale, x = numbers[n] < 0 ? zero - long : zero;
    const name = names ? (row[names]?.value ?? "").replace(/^.*[/#](?=.)/, "") : String(n + 1);
    return [
      drawn("text", { x: left - 8, y: y + 15, "text-anchor": "end" }, name.length > letters ? `${name.slice(0, letters - 1)}…` : name),
      drawn("rect", { x, y: y + 3, width: long, height: ROW - 6 }),
      drawn("text", { x: x + long + 6, y: y + 15 }, short(numbers[n])),
    ];
  });
  const more = rows.length - shown.length;
  const label = `${value}${names ? ` by ${names}` : ""}: ${shown.length} bars from ${short(Math.min(...numbers))} to ${short(Math.max(...numbers))}`;
  return element("figure", "", element("figcaption", `${label}${more > 0 ? `; ${more} rows are not drawn` : ""}`), picture(width, shown.length * ROW, label, parts));
}

function lineOf(rows, over, value, width) {
  const at = (term) => (isTime(term) ? Date.parse(term.value) : Number(term.value));
  const points = rows.filter((row) => row[over] && row[value]).map((row) => [at(row[over]), Number(row[value].value), row[over].value])
    .sort((a, b) => a[0] - b[0]);
  if (!points.length) return element("p", `no row has both ${over} and ${value}`);
  const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
  const [x, y] = [scaleOf(xs, MARGIN, width - 20), scaleOf(ys, HEIGHT - MARGIN, 20)];
  const low = ys.reduce((a, b) => Math.min(a, b), Infinity), high = ys.reduce((a, b) => Math.max(a, b), -Infinity);
  const label = `${value} over ${over}: ${points.length} points from ${short(low)} to ${short(high)}`;
  return element("figure", "", element("figcaption", label), picture(width, HEIGHT, label, [
    drawn("path", { class: "axis", d: `M ${MARGIN} 20 V ${HEIGHT - MARGIN} H ${width - 20}` }),
    drawn("polyline", { points: points.map((p) => `${x(p[0]).toFixed(1)},${y(p[1]).toFixed(1)}`).join(" ") }),
    drawn("text", { x: MARGIN - 8, y: y(low) + 4, "text-anchor": "end" }, short(low)),
    drawn("text", { x: MARGIN - 8, y: y(high) + 4, "text-anchor": "end" }, short(high)),
    drawn("text", { x: MARGIN, y: HEIGHT - MARGIN + 22 }, points[0][2]),
    drawn("text", { x: width - 20, y: HEIGHT - MARGIN + 22, "text-anchor": "end" }, points[points.length - 1][2]),
  ]));
}

function scaleOf(values, start, end) {
  const low = values.reduce((a, b) => Math.min(a, b), Infinity), high = values.reduce((a, b) => Math.max(a, b), -Infinity);
  return (value) => (high > low ? start + ((value - low) / (high - low)) * (end - start) : (start + end) / 2);
}

function short(number) {
  return String(Number(number.toPrecision(4)));
}
