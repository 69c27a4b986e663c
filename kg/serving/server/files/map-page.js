// The page of the live map: its parts, the selected thing, and the address of that thing.
import { AnswerPanel } from "/files/answer-panel.js";
import { Corrections } from "/files/corrections.js";
import { MapData } from "/files/map-data.js";
import { MapView } from "/files/map-view.js";
import { ObjectList, offerExports } from "/files/object-list.js";
import { PageAddress, readAddress } from "/files/page-address.js";
import { all, byId, reveal, status } from "/files/page-elements.js";
import { enter } from "/files/server.js";
import { ThingPanel } from "/files/thing-panel.js";
import { ChangePanel, TimeAxis } from "/files/time-axis.js";

const data = new MapData(await enter(byId("map")));
const list = new ObjectList(data, goTo, refresh);
const view = new MapView(byId("canvas"), data, shown);
const corrections = new Corrections(data, view, () => { if (view.selected) panel.show(view.selected, list.least); });
const panel = new ThingPanel(data, goTo, (thing) => corrections.offer(thing));
const axis = new TimeAxis(data, () => changes.compare(changes.from));
const changes = new ChangePanel(data, view, goToChange);
const search = new AnswerPanel(data, view, { found, choose: goTo, asked: () => bringToFront("plan") });
const address = new PageAddress({ data, view, changes, search });
let listing = 0, hasState = false; // whether the map was read
let connection = ["", "connecting …"]; // class and words of the feed's state
let isMeasuring = false; // whether clicks on the map are ends of a distance

function shown(one) {
  return one.iri === view.selected || list.passes(one);
}

/** Request a drawing; the lists follow a little later, since they take longer. */
function refresh() {
  view.draw();
  address.write();
  listing ||= setTimeout(() => { listing = 0; showLists(); }, 300);
}

function showLists() {
  list.show(shown, view.selected, view.dark);
  byId("cut-shown").textContent = view.cut.toFixed(1);
  byId("cut").value = view.cut;
  reveal("empty", hasState && !data.objects.size && !data.places.size && !data.floor.length);
  reveal("empty-now", data.past === null);
  if (!panel.isBehind) return;
  if (panel.mayChange) panel.show(view.selected, list.least);
  else setTimeout(refresh, 500);
}

/** Select a thing, or nothing; it comes to the front of the panel unless it was `found`. */
function choose(iri, { isFound = false } = {}) {
  view.selected = iri;
  if (view.isFocused) focus(data.objects.has(iri));
  address.writeNow();
  panel.show(iri, list.least);
  if (!isFound) bringToFront(iri || !search.wanted ? "about" : "plan");
  refresh();
}

/** Show the answer ("plan") or the selected thing ("about"), from its top. */
function bringToFront(id) {
  byId("side").dataset.front = id;
  byId("side").scrollTop = 0;
  reveal("back", id !== "plan" && search.wanted !== "");
}

/** Go to what an answer found; without it, show all that it is about, and select nothing. */
function found(iri) {
  if (iri) goTo(iri, { isFound: true });
  else { choose(null, { isFound: true }); if (view.highlights.iris.size) view.fit(); }
}

/** Select a thing and centre it. */
function goTo(iri, options = {}) {
  const one = data.thingAt(iri), place = data.places.get(iri);
  if (one) view.goTo(one.x, one.y, undefined, one.z);
  if (place) view.goTo((place.xmin + place.xmax) / 2, (place.ymin + place.ymax) / 2, view.scale);
  choose(iri, options);
}

/** Select a changed thing; one that is gone has only its former position. */
function goToChange({ iri, was, now }) {
  if (data.has(data.base + iri)) goTo(data.base + iri);
  else if (now || was) view.goTo(...(now || was));
}

/** Show what the address names; an address without parameters only selects a thing. */
async function goToAddress() {
  const { thing, given } = readAddress(location.hash);
  const hasView = await address.follow(given, { show: (at) => axis.show(at), turn, cut, filter: (...values) => list.filter(...values) });
  const iri = [thing, data.base + thing].find((one) => data.thingAt(one) || data.places.has(one)) || null;
  if (hasView) choose(iri, { isFound: given.has("find") });
  else goTo(iri, { isFound: given.has("find") });
  if (given.has("focus") !== view.isFocused) focus(given.has("focus"), { stays: hasView });
}

/** Show the map in three dimensions, or flat again. */
function turn() {
  view.turn();
  byId("solid").setAttribute("aria-pressed", String(!view.isFlat));
  address.write();
}

/** Fade everything but the selected thing, or end that. */
function focus(isFocused = !view.isFocused, options = {}) {
  if (isFocused && !data.objects.has(view.selected)) return status("select an object first: click on the map or in the list");
  view.focus(isFocused, options);
  byId("focus").setAttribute("aria-pressed", String(view.isFocused));
  return address.write();
}

/** Begin to measure a distance by two clicks, or end that. */
function measure(isOn = !isMeasuring) {
  isMeasuring = isOn;
  byId("measure").setAttribute("aria-pressed", String(isOn));
  if (isOn) byId("canvas").focus();
  showMeasured([]);
}

/** Show points [m], at most two, and how far apart they are. */
function showMeasured(points) {
  view.measured = points;
  view.draw();
  const height = points.length === 2 && !view.isFlat ? `, ${Math.abs(points[1][2] - points[0][2]).toFixed(2)} m of it in height` : "";
  if (!isMeasuring) status("");
  else if (points.length === 2) status(`${view.distance().toFixed(2)} m apart${height}`);
  else status(`click the ${points.length ? "second" : "first"} point; the space bar takes the middle of the map, Escape ends`);
}

/** Cut walls at a height [m] above the floor; null: where it suits. */
const cut = (height) => { view.height = height; refresh(); };

function showTransaction({ sequence, cause }) {
  byId("sequence").textContent = sequence;
  byId("cause").textContent = [cause.by, cause.note || cause.kind].filter(Boolean).join(": ");
  axis.follow();
}

const CLICKS = { solid: turn, focus, measure, fit: () => view.fit(), closer: () => view.camera.zoom(1.4), farther: () => view.camera.zoom(1 / 1.4), back: () => bringToFront("plan") };
for (const [id, act] of Object.entries(CLICKS)) byId(id).addEventListener("click", () => act());
byId("cut").addEventListener("input", () => cut(Number(byId("cut").value)));
all("[data-layer]").forEach((box) => box.addEventListener("change", () => {
  view.layers[box.dataset.layer] = box.checked;
  reveal("viewed-legend", view.layers.viewed);
  refresh();
}));
view.onMove = () => address.write();
view.onSurface = refresh;
offerExports(data, view, shown);
view.onPick = (iri, point) => {
  if (isMeasuring) showMeasured(view.measured.length === 1 ? [...view.measured, point] : [point]);
  else if (!corrections.place(point)) choose(iri);
};
data.addEventListener("changed", refresh);
document.addEventListener("click", ({ target }) => closeMenus(target));
document.addEventListener("keydown", ({ key }) => {
  if (key !== "Escape") return;
  closeMenus(null);
  if (isMeasuring) measure(false);
});
data.addEventListener("on", () => say(...(connection = ["on", "live"])));
data.addEventListener("off", () => say(...(connection = ["off", "not connected, so this may be old; trying again …"])));
window.addEventListener("busy", () => say("off", "the server is busy; asking it again …"));
window.addEventListener("answered", () => say(...connection));
data.addEventListener("categories", () => { corrections.offerCategories(); refresh(); });
data.addEventListener("transaction", (event) => showTransaction(/** @type {CustomEvent} */ (event).detail));
window.addEventListener("hashchange", goToAddress);

/** Whether the page is connected, in words. */
function say(state, words) {
  byId("live").className = `live dim ${state}`;
  byId("state").textContent = words;
}

/** Close the menus that a click was not in. */
function closeMenus(target) {
  all(".tools details[open]").forEach((menu) => { if (!menu.contains(target)) menu.open = false; });
}

/** Read the map, again and again until it comes. */
async function read(pause = 1) {
  try {
    await data.load();
  } catch (error) {
    say("off", `${error.message || "the server does not answer"}; trying again in ${pause} s`);
    await new Promise((done) => setTimeout(done, 1000 * pause));
    await read(Math.min(2 * pause, 30));
  }
}

read().then(async () => {
  hasState = true;
  say(...connection);
  byId("sequence").textContent = data.sequence;
  view.fit();
  showLists();
  corrections.offerCategories();
  data.follow();
  axis.follow();
  await goToAddress();
  document.documentElement.dataset.ready = "true";
}).catch((error) => status(`the map cannot be shown: ${error.message}`));
