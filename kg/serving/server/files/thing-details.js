// Details of a thing that the page requests from the server: relations, explanation, history, picture.
import { button, element } from "/files/page-elements.js";
import { request, select } from "/files/server.js";

const SVG = "http://www.w3.org/2000/svg";

/** The things that it is on, in or beside, and those that are on, in or beside it. */
export async function relationsOf(data, iri, choose) {
  const { rows } = await select(`SELECT ?kind ?other ?chance ?turned WHERE { GRAPH graph:map {
      { <${iri}> here:hasRelation ?r . ?r here:relatedTo ?other . BIND(false AS ?turned) }
      UNION { ?other here:hasRelation ?r . ?r here:relatedTo <${iri}> . BIND(true AS ?turned) }
      ?r here:ofRelation ?kind ; here:relationProbability ?chance } } ORDER BY DESC(?chance) LIMIT 12`, data.past);
  const items = unique(rows).map((row) => {
    const kind = row.kind.replace(/.*#/, ""), other = data.objects.get(row.other);
    const name = other ? data.nameOf(other) : data.pathOf(row.other);
    const words = row.turned === "true" ? { on: "under", inside: "around" }[kind] || kind : kind;
    return element("li", `${words} `, button(name, () => choose(row.other)), ` ${Number(row.chance).toFixed(2)}`);
  });
  return [element("ul", "", ...items)];
}

/** Relations without the second direction of symmetric ones. */
function unique(rows) {
  const known = new Set();
  return rows.filter((row) => {
    const key = `${row.kind} ${row.other} ${row.kind.endsWith("#beside") || row.turned}`;
    return !known.has(key) && known.add(key);
  });
}

/** The explanation, as of `hereabouts why`; only of the present. */
export async function whyOf(data, iri) {
  if (data.past !== null) return [element("p", "Reasons are told for the present: choose now.")];
  const answer = await request(`/why?iri=${encodeURIComponent(data.pathOf(iri))}`, { accept: "text/plain" });
  return [element("pre", await answer.text())];
}

/** Its existence over time, and its last changes. */
export async function historyOf(data, iri) {
  const answer = await request(`/log?iri=${encodeURIComponent(data.pathOf(iri))}&last=200`, { accept: "application/json" });
  const events = (await answer.json()).filter((event) => data.past === null || event.sequence <= data.past);
  const items = events.slice(-8).reverse().map((event) =>
    element("li", `${event.time.slice(0, 19).replace("T", " ")} #${event.sequence} ${event.by || event.kind}: ${event.changes.slice(0, 4).join("; ")}`));
  return [sparkline(events), element("ul", "", ...items)];
}

/** Existence over time as a small chart. */
function sparkline(events) {
  const values = [];
  for (const event of events) for (const change of event.changes) {
    const found = /^existence (?:\S+ -> )?([0-9.]+)$/.exec(change);
    if (found) values.push(Number(found[1]));
  }
  if (values.length < 2) return element("p", values.length ? `existence ${values[0]}` : "no change of existence is kept");
  const svg = document.createElementNS(SVG, "svg"), line = document.createElementNS(SVG, "polyline");
  svg.setAttribute("viewBox", "-2 -2 204 44");
  svg.setAttribute("class", "sparkline");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `existence over time: ${values.join(", ")}`);
  line.setAttribute("points", values.map((value, n) => `${(200 * n) / (values.length - 1)},${40 - 40 * value}`).join(" "));
  svg.append(line);
  return svg;
}

/** The picture of an object's best observation, drawn; null where none is kept. */
export async function pictureOf(data, iri) {
  const number = /^object\/(\d+)$/.exec(data.pathOf(iri));
  if (!number || data.past !== null) return null; // a picture of the present would not belong here
  const answer = await request(`/pictures/${number[1]}`, { accept: "image/jpeg" }).catch(() => null);
  const image = answer?.status === 200 && await createImageBitmap(await answer.blob()).catch(() => null);
  if (!image) return null;
  const picture = document.createElement("canvas");
  [picture.width, picture.height] = [image.width, image.height];
  picture.getContext("2d").drawImage(image, 0, 0);
  picture.setAttribute("role", "img");
  picture.setAttribute("aria-label", `${data.nameOf(data.thingAt(iri))} as it was seen best`);
  return picture;
}
