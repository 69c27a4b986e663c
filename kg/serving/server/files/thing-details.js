// Details of a thing that the page requests from the server: relations, explanation, history, picture.
import { button, element, named } from "/files/page-elements.js";
import { request, select } from "/files/server.js";
import { clock } from "/files/time-axis.js";

const HERE = "https://w3id.org/hereabouts#";
const TURNED = { on: "with … on it", inside: "with … in it" };
const ASIDES = new Set(["model", "pose", "commit", "change", "person"]); // reasons in small print
const BESIDE = 0.15 / 1.3; // of the longer side of a picture, from its edge to the box (perception/annotate.py)
const MAX_EVENTS = 12;

export const percent = (share) => `${Math.round(100 * share)} %`;

/** What it is on, in or beside, and what is on or in it: a list of phrases with links, the surest first. */
export async function relationsOf(data, iri, choose) {
  const { rows } = await select(`SELECT ?kind ?other ?chance ?turned WHERE { GRAPH graph:map {
      { <${iri}> here:hasRelation ?r . ?r here:relatedTo ?other . BIND(false AS ?turned) }
      UNION { ?other here:hasRelation ?r . ?r here:relatedTo <${iri}> . BIND(true AS ?turned) }
      ?r here:ofRelation ?kind ; here:relationProbability ?chance } } ORDER BY DESC(?chance) LIMIT 12`, data.past);
  const phrases = new Map(); // words before and after -> links
  const told = new Set();
  for (const { kind: relation, other, chance, turned } of rows) {
    const kind = relation.replace(/.*#/, ""), words = (turned === "true" && TURNED[kind]) || `${kind} …`, one = data.objects.get(other);
    if (!one || told.has(`${words} ${other}`) || !told.add(`${words} ${other}`)) continue;
    const link = button("", () => choose(other));
    link.className = "link";
    link.title = `${percent(Number(chance))} sure`;
    link.append(...named(data, one));
    phrases.set(words, [...(phrases.get(words) ?? []), ", the ", link]);
  }
  return [...phrases].map(([words, [, ...links]]) => element("span", words.split("…")[0] + "the ", ...links, words.split("…")[1]));
}

/** The explanation as steps, of a thing or of one of its facts; only of the present. */
export async function whyOf(data, what) {
  if (data.past !== null) return [element("p", "Reasons are told for the present: choose now.")];
  const answer = await request(`/why?what=${encodeURIComponent(what)}`, { accept: "application/json" });
  const reasons = (await answer.json()).flatMap((one) => (one.kind === "thing" ? one.because : [one])); // which thing it is, the page says already
  return [stepsOf(data, reasons, data.fullOf(what.split(" ")[0]))];
}

/** Steps, each with where and when it was made in small print; what was seen has its picture. */
function stepsOf(data, reasons, iri) {
  return element("ol", "", ...reasons.map((reason) => {
    const { text, because } = reason, made = element("li", "", element("span", plain(data, text)), element("small", asidesOf(reason).map((one) => plain(data, one)).join("; ")));
    const steps = because.filter(({ kind }) => !ASIDES.has(kind));
    if (reason.kind === "observation") pictureOf(data, iri).then((picture) => picture && made.prepend(boxed(picture)), () => {});
    if (steps.length) made.append(stepsOf(data, steps, iri));
    return made;
  }));
}

const asidesOf = ({ because }) => because.filter(({ kind }) => ASIDES.has(kind)).flatMap((one) => [one.text, ...asidesOf(one)]);

/** A picture with the box in which the thing was seen: the picture has a margin around it. */
function boxed(picture) {
  const c = picture.getContext("2d"), side = Math.max(picture.width, picture.height), inset = BESIDE * side;
  for (const [colour, wide] of [["#fff", side / 40], ["#d55e00", side / 80]]) {
    Object.assign(c, { strokeStyle: colour, lineWidth: wide });
    c.strokeRect(inset, inset, picture.width - 2 * inset, picture.height - 2 * inset);
  }
  return picture;
}

/** A line of an explanation in the words of the page: names, clock times, percentages. */
function plain(data, text) {
  return text.replace(/^transaction #\d+ at/, "written at").replace("rdf:type here:", "is a here:")
    .replace(/: box [\d .-]+ px, score ([\d.]+)/, (_, score) => `, with ${percent(score)}`)
    .replace(/\d{4}-\d\d-\d\dT[\d:.]+Z/g, (time) => clock(time))
    .replace(/\b(?:object|place)\/\d+(?: \([^)]*\))?/g, (path) => data.nameAt(data.fullOf(path.split(" ")[0])))
    .replace(/\bhere:(\w+)/g, (_, name) => data.labels.get(HERE + name) ?? name.replace(/([A-Z])/g, (capital) => ` ${capital.toLowerCase()}`));
}

/** What happened to it, as `/log` tells it, the last first. */
export async function historyOf(data, iri) {
  const answer = await request(`/log?iri=${encodeURIComponent(data.pathOf(iri))}&last=200`, { accept: "application/json" });
  const events = (await answer.json()).filter(({ sequence, told }) => told.length && (data.past === null || sequence <= data.past));
  return [element("ul", "", ...events.slice(-MAX_EVENTS).reverse().map(({ time, by, note, told }) => {
    const item = element("li", "", element("small", clock(time)), plain(data, told.join("; ")) + (by ? ` (${by})` : ""));
    item.title = note ?? "";
    return item;
  }))];
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
  picture.setAttribute("aria-label", `${data.nameAt(iri)} as it was seen best`);
  return picture;
}
