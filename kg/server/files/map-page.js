// The page around the map: what is selected, filters, search, the past, corrections.
import { MapData, select } from "/files/map-data.js";
import { MapView, colourOf } from "/files/map-view.js";

const byId = (id) => document.getElementById(id);
const data = new MapData(byId("map").dataset.base);
const filters = { text: "", place: "", least: 0.5, age: Infinity };
const view = new MapView(byId("canvas"), data, shown);
let token = ""; // in memory alone: gone with the page
let moving = null;
let playing = null;

/** An element with text and children; text is never markup. */
function element(name, text = "", ...children) {
  const made = document.createElement(name);
  made.textContent = text;
  made.append(...children);
  return made;
}

function button(text, onClick) {
  const made = element("button", text);
  made.type = "button";
  made.addEventListener("click", onClick);
  return made;
}

function path(iri) {
  return iri.startsWith(data.base) ? iri.slice(data.base.length) : iri;
}

function seconds(time) {
  return Date.parse(time) / 1000;
}

/** The time of the map: when something was last seen in it. */
function now() {
  let latest = 0;
  for (const one of data.objects.values()) if (one.seen) latest = Math.max(latest, seconds(one.seen));
  return latest;
}

function ago(time) {
  const age = Math.max(now() - seconds(time), 0);
  const [count, unit] = age < 90 ? [age, "s"] : age < 5400 ? [age / 60, "min"] : age < 172800 ? [age / 3600, "h"] : [age / 86400, "days"];
  return `${Math.round(count)} ${unit}`;
}

function shown(one) {
  if (one.iri === view?.selected) return true;
  if (!(one.existence >= filters.least)) return false;
  if (filters.place && one.place !== filters.place) return false;
  if (filters.age !== Infinity && !(filters.latest - seconds(one.seen || 0) <= filters.age)) return false;
  const words = filters.text;
  return !words || data.nameOf(one).toLowerCase().includes(words) || data.labelOf(one.class).toLowerCase().includes(words);
}

// ---------------------------------------------------------------- lists beside the map

let listing = 0;
function refresh() {
  view.draw();
  if (listing) return;
  listing = setTimeout(() => { listing = 0; list(); }, 300);
}

function list() {
  filters.latest = now();
  const objects = [...data.objects.values()].filter(shown);
  const counts = new Map();
  for (const one of objects) counts.set(one.class, (counts.get(one.class) || 0) + 1);
  byId("count").textContent = `${objects.length} of ${data.objects.size} objects, ${data.places.size} places`;
  const legend = [...counts].sort((a, b) => b[1] - a[1]).slice(0, 40).map(([category, count]) => {
    const label = data.labelOf(category);
    const swatch = element("i");
    swatch.style.background = colourOf(label, view.dark);
    const made = button("", () => { byId("filter").value = label; filter(); });
    made.append(swatch, ` ${label} `, element("b", String(count)));
    return element("li", "", made);
  });
  byId("legend").replaceChildren(...legend);
  const rows = objects.sort((a, b) => b.existence - a.existence || (a.iri < b.iri ? -1 : 1)).slice(0, 200).map((one) => {
    const place = data.places.get(one.place);
    const made = button(data.nameOf(one), () => choose(one.iri, true));
    made.setAttribute("aria-current", String(one.iri === view.selected));
    const where = place ? `in ${placeName(place)}` : "";
    return element("li", "", made, element("span", ` ${where}, existence ${one.existence.toFixed(2)}`));
  });
  byId("objects").replaceChildren(...rows);
  const places = byId("in-place"), chosen = places.value;
  const options = [...data.places.values()].map((place) => { const o = element("option", placeName(place)); o.value = place.iri; return o; });
  const any = element("option", "anywhere");
  any.value = "";
  places.replaceChildren(any, ...options);
  places.value = data.places.has(chosen) ? chosen : "";
  describeChanges();
}

function placeName(place) {
  const best = place.beliefs[0];
  return best ? `${data.nameOf(place)} (${data.labelOf(best[0])})` : data.nameOf(place);
}

function filter() {
  filters.text = byId("filter").value.trim().toLowerCase();
  filters.place = byId("in-place").value;
  filters.least = Number(byId("least").value);
  filters.age = Number(byId("age").value) || Infinity;
  filters.latest = now();
  byId("least-shown").textContent = filters.least.toFixed(2);
  refresh();
}

// ---------------------------------------------------------------- one thing

let described = ""; // what is shown of the selected thing, and since when
let describedAt = 0;

function selectedThing() {
  return data.objects.get(view.selected) || data.places.get(view.selected) || null;
}

/** Describe the selected thing anew where it has changed: once a second, and not while somebody types. */
function describeChanges() {
  if (!view.selected || JSON.stringify(selectedThing()) === described) return;
  const typing = document.activeElement?.matches("#about input");
  if (typing || performance.now() < describedAt + 1000) setTimeout(refresh, 500);
  else choose(view.selected);
}

function choose(iri, go = false) {
  view.selected = iri;
  described = JSON.stringify(selectedThing());
  describedAt = performance.now();
  history.replaceState(null, "", iri ? `#${encodeURI(path(iri))}` : "#");
  const one = data.objects.get(iri), place = data.places.get(iri);
  if (go && one) view.goTo(one.x, one.y);
  if (go && place) view.goTo((place.xmin + place.xmax) / 2, (place.ymin + place.ymax) / 2, view.scale);
  byId("about").replaceChildren(...(one ? aboutObject(one) : place ? aboutPlace(place) : [element("p", "Nothing is selected: click on the map or in the list.")]));
  if (one || place) { tell(iri); showPicture(iri); }
  refresh();
}

function facts(pairs) {
  return element("dl", "", ...pairs.filter(([, value]) => value).flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
}

function aboutObject(one) {
  const place = data.places.get(one.place);
  const size = one.dx ? `${one.dx.toFixed(2)} x ${one.dy.toFixed(2)} x ${one.dz.toFixed(2)} m` : "";
  const made = [
    element("h2", data.nameOf(one)),
    element("div"),
    facts([
      ["category", data.labelOf(one.class)],
      ["where", place ? `in ${placeName(place)}` : ""],
      ["existence", one.existence.toFixed(2)],
      ["position", `${one.x.toFixed(2)}, ${one.y.toFixed(2)}, ${(one.z ?? 0).toFixed(2)} m${one.deviation ? ` ± ${one.deviation.toFixed(2)} m` : ""}`],
      ["size", size],
      ["last seen", one.seen ? `${one.seen.replace("T", " ").replace("Z", " UTC")}, ${ago(one.seen)} before the last view of the map` : ""],
      ["seen", one.count ? `${one.count} times` : ""],
    ]),
  ];
  const near = [...data.objects.values()].filter((other) => other !== one && other.existence >= 0.5)
    .map((other) => [Math.hypot(other.x - one.x, other.y - one.y), other]).sort((a, b) => a[0] - b[0]).slice(0, 5);
  const items = near.map(([distance, other]) => element("li", "", button(data.nameOf(other), () => choose(other.iri, true)), ` ${distance.toFixed(2)} m`));
  made.push(element("h3", "Near it"), element("ul", "", ...items), slot("relations", "On, in and beside"), slot("why", "Why"), slot("history", "History"));
  if (token) made.push(corrections(one));
  made.push(dataLink(one.iri));
  return made;
}

function aboutPlace(place) {
  const beliefs = place.beliefs.slice(0, 6).map(([category, belief]) => {
    const bar = element("meter");
    bar.value = belief;
    return element("li", `${data.labelOf(category)} ${belief.toFixed(2)} `, bar);
  });
  const here = [...data.objects.values()].filter((one) => one.place === place.iri && one.existence >= filters.least);
  const things = here.map((one) => element("li", "", button(data.nameOf(one), () => choose(one.iri, true))));
  const made = [
    element("h2", placeName(place)),
    facts([
      ["viewed", place.share !== undefined ? `${Math.round(place.share * 100)} % of its floor` : ""],
      ["last viewed", place.viewed ? place.viewed.replace("T", " ").replace("Z", " UTC") : ""],
    ]),
    element("h3", "What it is believed to be"), element("ul", "", ...beliefs),
    element("h3", "What is in it"), element("ul", "", ...things), slot("why", "Why"), slot("history", "History"),
  ];
  if (token) made.push(corrections(place));
  made.push(dataLink(place.iri));
  return made;
}

function dataLink(iri) {
  const link = element("a", "all its facts, as a page and as data");
  link.href = iri.startsWith(data.base) ? `/${path(iri)}` : `/resource?iri=${encodeURIComponent(iri)}`;
  return element("p", "", link);
}

function slot(id, title) {
  const made = element("details", "", element("summary", title), element("div", "…"));
  made.id = `about-${id}`;
  made.open = id !== "why";
  return made;
}

/** The picture of an object's best observation, where one is kept. */
function showPicture(iri) {
  const number = /^object\/(\d+)$/.exec(path(iri));
  if (!number || !data.objects.has(iri)) return;
  const picture = new Image();
  picture.alt = `${data.nameOf(data.objects.get(iri))} as it was seen best`;
  picture.onload = () => { if (view.selected === iri) byId("about").querySelector("h2 + div")?.replaceChildren(picture); };
  picture.src = `/pictures/${number[1]}`;
}

/** Fill in what the server is asked for about a thing. */
async function tell(iri) {
  const about = `iri=${encodeURIComponent(path(iri))}`;
  const fill = (id, ...content) => {
    const place = byId(`about-${id}`)?.lastElementChild;
    if (place && view.selected === iri) place.replaceChildren(...content);
  };
  const failed = (id) => (error) => fill(id, element("p", error.message));
  const text = async (address, accept) => {
    const answer = await fetch(address, { headers: { Accept: accept } });
    if (!answer.ok) throw new Error((await answer.text()).slice(0, 200));
    return answer;
  };
  select(`SELECT ?kind ?other ?chance ?turned WHERE { GRAPH graph:map {
      { <${iri}> here:hasRelation ?r . ?r here:relatedTo ?other . BIND(false AS ?turned) }
      UNION { ?other here:hasRelation ?r . ?r here:relatedTo <${iri}> . BIND(true AS ?turned) }
      ?r here:ofRelation ?kind ; here:relationProbability ?chance } } ORDER BY DESC(?chance) LIMIT 12`, data.past)
    .then(({ rows }) => fill("relations", element("ul", "", ...unique(rows).map((row) => {
      const kind = row.kind.replace(/.*#/, ""), other = data.objects.get(row.other);
      const name = other ? data.nameOf(other) : path(row.other);
      const words = row.turned === "true" ? { on: "under", inside: "around" }[kind] || kind : kind;
      return element("li", `${words} `, button(name, () => choose(row.other, true)), ` ${Number(row.chance).toFixed(2)}`);
    })))).catch(failed("relations"));
  text(`/why?${about}`, "text/plain").then((answer) => answer.text()).then((words) => fill("why", element("pre", words))).catch(failed("why"));
  text(`/log?${about}&last=200`, "application/json").then((answer) => answer.json()).then((events) => {
    const items = events.slice(-8).reverse().map((event) =>
      element("li", `${event.time.slice(0, 19).replace("T", " ")} #${event.sequence} ${event.by || event.kind}: ${event.changes.slice(0, 4).join("; ")}`));
    fill("history", sparkline(events), element("ul", "", ...items));
  }).catch(failed("history"));
}

/** Relations without the second half of those that hold both ways. */
function unique(rows) {
  const known = new Set();
  return rows.filter((row) => {
    const key = `${row.kind} ${row.other} ${row.kind.endsWith("#beside") || row.turned}`;
    return !known.has(key) && known.add(key);
  });
}

/** How existence went, as a small picture. */
function sparkline(events) {
  const values = [];
  for (const event of events) for (const change of event.changes) {
    const found = /^existence (?:\S+ -> )?([0-9.]+)$/.exec(change);
    if (found) values.push(Number(found[1]));
  }
  const ns = "http://www.w3.org/2000/svg", svg = document.createElementNS(ns, "svg"), line = document.createElementNS(ns, "polyline");
  svg.setAttribute("viewBox", "-2 -2 204 44");
  svg.setAttribute("class", "sparkline");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `existence over time: ${values.join(", ")}`);
  line.setAttribute("points", values.map((value, n) => `${(200 * n) / Math.max(values.length - 1, 1)},${40 - 40 * value}`).join(" "));
  svg.append(line);
  return values.length > 1 ? svg : element("p", values.length ? `existence ${values[0]}` : "no change of existence is kept");
}

// ---------------------------------------------------------------- corrections

function corrections(one) {
  const isPlace = data.places.has(one.iri);
  const name = element("input");
  name.value = one.label || "";
  name.setAttribute("aria-label", "name");
  const category = element("input");
  category.setAttribute("list", isPlace ? "place-categories" : "object-categories");
  category.setAttribute("aria-label", "category");
  category.placeholder = isPlace ? "e.g. kitchen" : "e.g. bowl";
  const made = element("fieldset", "", element("legend", "Correct it"),
    element("p", "", name, button("rename", () => assert(one.iri, "label", name.value))),
    element("p", "", category, button("is a", () => assert(one.iri, "category", category.value))));
  if (!isPlace) {
    made.append(element("p", "",
      button("move", () => { moving = one.iri; status("click where it is"); }),
      button("it is not there", () => assert(one.iri, "existence", "absent"))));
  }
  made.append(element("p", "", button("undo", () => retract(one.iri))));
  return made;
}

async function assert(thing, property, value) {
  await send("/assertions", "POST", { thing: path(thing), property, value }, `${property}: ${value}`);
}

/** Take back the last assertion about a thing. */
async function retract(thing) {
  const answer = await fetch(`/assertions?iri=${encodeURIComponent(path(thing))}`, { headers: { Accept: "application/json" } });
  const made = answer.ok ? await answer.json() : [];
  const all = Array.isArray(made) ? made : made.assertions || [];
  const last = all.sort((a, b) => (a.stamp > b.stamp ? 1 : -1)).pop();
  if (!last) return status("nothing was asserted about it");
  return send(`/assertions?iri=${encodeURIComponent(path(thing))}&property=${last.property}`, "DELETE", null, `retracted: ${last.property}`);
}

async function send(address, method, body, done) {
  const answer = await fetch(address, {
    method,
    headers: { Authorization: `Bearer ${token}`, "Content-Type": "application/json", Accept: "application/json" },
    body: body && JSON.stringify(body),
  });
  const text = await answer.text();
  let reason = text;
  try { reason = JSON.parse(text).detail || JSON.parse(text).title || text; } catch { /* plain text */ }
  status(answer.ok ? done : reason.slice(0, 300));
  if (answer.ok && view.selected) setTimeout(() => choose(view.selected), 700);
}

function status(text) {
  byId("status").textContent = text;
}

// ---------------------------------------------------------------- search, past, layers

async function find(event) {
  event.preventDefault();
  const wanted = byId("wanted").value.trim();
  if (!wanted) { view.plan = null; byId("plan").replaceChildren(); return view.draw(); }
  byId("plan").replaceChildren(element("p", "planning …"));
  const answer = await fetch(`/find?object=${encodeURIComponent(wanted)}`, { headers: { Accept: "application/json" } });
  const found = await answer.json().catch(() => ({ title: `no plan: the server answered ${answer.status}` }));
  if (!answer.ok || !found.steps) return byId("plan").replaceChildren(element("p", found.detail || found.title));
  view.plan = found;
  const known = found.known.slice(0, 4).map((one) => element("li", "", button(one.label, () => choose(one.iri, true)),
    ` ${one.where || ""}, existence ${one.existence.toFixed(2)}${one.last_seen ? `, seen ${ago(one.last_seen)} ago` : ""}`));
  const given = new Set(); // reasons, each told once
  const steps = found.steps.slice(0, 12).map((step, n) => {
    const reason = step.why.find((one) => !given.has(one.iri));
    if (reason) given.add(reason.iri);
    return element("li", "", button(`look ${n + 1}`, () => view.goTo(step.x, step.y)),
      ` by ${Math.round(step.seconds)} s, finds it with ${step.probability.toFixed(3)}`,
      element("small", reason ? reason.facts.slice(0, 2).join("; ") : ""));
  });
  byId("plan").replaceChildren(
    element("h3", known.length ? "What the map has" : `No ${wanted} is in the map`), element("ul", "", ...known),
    element("h3", known.length ? "If it is not there" : "Where to look"),
    element("p", `on this floor with ${found.present.toFixed(2)}; the plan finds it with ${found.probability.toFixed(2)}`),
    element("ol", "", ...steps));
  return view.draw();
}

function showPast(sequence) {
  const present = sequence >= data.last;
  byId("moment").textContent = present ? "now" : `transaction ${sequence} of ${data.last}`;
  data.load(present ? null : sequence).catch((error) => status(error.message));
}

function play() {
  if (playing) { clearInterval(playing); playing = null; byId("play").textContent = "play"; return; }
  const slider = byId("time");
  if (Number(slider.value) >= data.last) slider.value = 1;
  byId("play").textContent = "stop";
  const step = Math.max(1, Math.round(data.last / 120));
  let busy = false;
  playing = setInterval(async () => {
    if (busy) return;
    busy = true;
    const next = Math.min(Number(slider.value) + step, data.last);
    slider.value = next;
    const present = next >= data.last;
    byId("moment").textContent = present ? "now" : `transaction ${next} of ${data.last}`;
    try { await data.load(present ? null : next); } catch (error) { status(error.message); }
    busy = false;
    if (present && playing) play();
  }, 120);
}

byId("find").addEventListener("submit", find);
["filter", "least"].forEach((id) => byId(id).addEventListener("input", filter));
["in-place", "age"].forEach((id) => byId(id).addEventListener("change", filter));
byId("fit").addEventListener("click", () => view.fit());
byId("closer").addEventListener("click", () => view.zoom(1.4));
byId("farther").addEventListener("click", () => view.zoom(1 / 1.4));
byId("play").addEventListener("click", play);
byId("time").addEventListener("input", (event) => showPast(Number(event.target.value)));
document.querySelectorAll("[data-layer]").forEach((box) => box.addEventListener("change", () => {
  view.layers[box.dataset.layer] = box.checked;
  byId("viewed-legend").classList.toggle("hidden", !view.layers.viewed);
  view.draw();
}));
byId("corrector")?.addEventListener("submit", (event) => {
  event.preventDefault();
  token = byId("token").value.trim();
  byId("token").value = "";
  status(token ? "corrections are open until the page is left" : "");
  if (view.selected) choose(view.selected);
});
view.onPick = (iri, [x, y]) => {
  if (moving) {
    const one = data.objects.get(moving);
    assert(moving, "position", `${x.toFixed(2)} ${y.toFixed(2)} ${(one?.z ?? 0).toFixed(2)}`);
    moving = null;
    return;
  }
  choose(iri);
};
data.addEventListener("changed", () => {
  const slider = byId("time");
  slider.max = data.last;
  if (data.past === null) slider.value = data.last;
  refresh();
});
data.addEventListener("on", () => { byId("live").className = "live on"; });
data.addEventListener("off", () => { byId("live").className = "live off"; });
data.addEventListener("transaction", ({ detail }) => {
  byId("sequence").textContent = detail.sequence;
  byId("time").max = data.last;
  if (data.past === null) byId("time").value = data.last;
  byId("cause").textContent = [detail.cause.by, detail.cause.note || detail.cause.kind].filter(Boolean).join(": ");
});
window.addEventListener("hashchange", fromAddress);

function fromAddress() {
  let name = location.hash.slice(1);
  try { name = decodeURIComponent(name); } catch { /* a stray percent sign: taken as it is */ }
  const iri = [name, data.base + name].find((one) => data.objects.has(one) || data.places.has(one));
  choose(iri || null, true);
}

function offerCategories() {
  for (const kind of ["object", "place"]) {
    const options = [...data.labels].filter(([iri]) => data.kinds.get(iri) === kind).map(([, label]) => { const o = element("option"); o.value = label; return o; });
    byId(`${kind}-categories`).replaceChildren(...options);
  }
}

data.load().then(() => {
  view.fit();
  list();
  offerCategories();
  fromAddress();
  data.follow();
  document.documentElement.dataset.ready = "true";
}).catch((error) => status(`the map cannot be read: ${error.message}`));

