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
if (document.referrer === `${location.origin}/`) byId("back").addEventListener("click", (event) => { event.preventDefault(); history.back(); }); // as it was left

try {
  await data.load();
  view.selected = iri;
  view.layers.pictures = false;
  view.highlights.iris.add(iri);
  view.fit();
  const one = data.thingAt(iri);
  byId("title").textContent = data.nameAt(iri);
  if (one) view.goTo(one.x, one.y, Math.max(view.scale, SCALE));
  new ThingPanel(data, go).show(iri, 0.5);
} catch (error) {
  byId("status").textContent = error.message;
}
document.documentElement.dataset.ready = "true";
