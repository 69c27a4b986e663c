// The page of an object or place: what there is to say of it, and where it stands.
import { MapData } from "/files/map-data.js";
import { MapView } from "/files/map-view.js";
import { byId } from "/files/page-elements.js";
import { ThingPanel } from "/files/thing-panel.js";

const SCALE = 70; // [px/m] of the small map around an object
const { base, iri, at } = byId("thing").dataset; // `at` is the position [m] of what is no thing of the map, as a door
const data = new MapData(base);
const view = new MapView(byId("canvas"), data, (one) => one.existence >= 0.5 || one.iri === iri);
const go = (other) => { if (other && other !== iri) location.href = `/${data.pathOf(other)}`; };
view.onPick = go;
const panel = new ThingPanel(data, go), spot = at.split(" ").map(Number);
let isKnown = false; // whether the map has had it since the page was opened

/** Show what the feed of changes brings. */
function renew() {
  view.draw();
  byId("status").textContent = data.has(iri) || !isKnown ? "" : "It is no longer in the map. What was known of it last stands below.";
  if (!data.has(iri) || !panel.isBehind) return;
  byId("title").textContent = data.nameAt(iri);
  if (panel.mayChange) panel.show(iri, 0.5);
  else setTimeout(renew, 500);
}

try {
  await data.load();
  view.selected = iri;
  view.layers.pictures = view.layers.chosen = false; // the page has its own
  view.highlights.iris.add(iri);
  view.fit();
  const one = data.thingAt(iri);
  isKnown = data.has(iri);
  if (isKnown) byId("title").textContent = data.nameAt(iri);
  else if (at) view.highlights.points.push(spot);
  else byId("canvas").parentElement.remove();
  if (one || (at && !isKnown)) view.goTo(one?.x ?? spot[0], one?.y ?? spot[1], Math.max(view.scale, SCALE));
  panel.show(iri, 0.5);
  data.addEventListener("changed", renew);
  data.follow();
} catch (error) {
  byId("status").textContent = error.message;
}
document.documentElement.dataset.ready = "true";
