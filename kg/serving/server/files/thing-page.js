// The page of an object or place: where it stands, its picture, the reasons for it, and its history.
import { MapData } from "/files/map-data.js";
import { MapView } from "/files/map-view.js";
import { byId, element } from "/files/page-elements.js";
import { historyOf, pictureOf, whyOf } from "/files/thing-details.js";

const SCALE = 70; // [px/m] of the small map around an object
const { base, iri } = byId("thing").dataset;
const data = new MapData(base);
const view = new MapView(byId("canvas"), data, (one) => one.existence >= 0.5 || one.iri === iri);
view.onPick = (picked) => { if (picked && picked !== iri) location.href = `/${data.pathOf(picked)}`; };

async function fill(id, answer) {
  const content = await answer.catch((error) => [element("p", error.message)]);
  byId(id).replaceChildren(...content);
}

async function showPicture() {
  const picture = await pictureOf(data, iri);
  if (picture) byId("picture").replaceChildren(picture);
}

try {
  await data.load();
  view.selected = iri;
  view.highlights.iris.add(iri);
  view.fit();
  const one = data.thingAt(iri);
  if (one) view.goTo(one.x, one.y, Math.max(view.scale, SCALE));
  await Promise.all([showPicture(), fill("why", whyOf(data, iri)), fill("history", historyOf(data, iri))]);
} catch (error) {
  byId("status").textContent = error.message;
}
document.documentElement.dataset.ready = "true";
