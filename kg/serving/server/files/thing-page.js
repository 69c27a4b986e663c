// The page of an object or place: what there is to say of it, and where it stands.
import { MapData } from "/files/map-data.js";
import { MapView } from "/files/map-view.js";
import { byId } from "/files/page-elements.js";
import { ThingPanel } from "/files/thing-panel.js";

const SCALE = 70; // [px/m] of the small map around an object
const { base, iri } = byId("thing").dataset;
const data = new MapData(base);
const view = new MapView(byId("canvas"), data, (one) => one.existence >= 0.5 || one.iri === iri);
const go = (other) => { if (other && other !== iri) location.href = `/${data.pathOf(other)}`; };
view.onPick = go;
const panel = new ThingPanel(data, go);

/** Show what the feed of changes brings. */
function renew() {
  view.draw();
  byId("status").textContent = data.has(iri) ? "" : "It is no longer in the map. What was known of it last stands below.";
  if (!data.has(iri) || !panel.isBehind) return;
  byId("title").textContent = data.nameAt(iri);
  if (panel.mayChange) panel.show(iri, 0.5);
  else setTimeout(renew, 500);
}

try {
  await data.load();
  view.selected = iri;
  view.layers.pictures = false;
  view.highlights.iris.add(iri);
  view.fit();
  const one = data.thingAt(iri);
  byId("title").textContent = data.nameAt(iri);
  if (one) view.goTo(one.x, one.y, Math.max(view.scale, SCALE));
  panel.show(iri, 0.5);
  data.addEventListener("changed", renew);
  data.follow();
} catch (error) {
  byId("status").textContent = error.message;
}
document.documentElement.dataset.ready = "true";
