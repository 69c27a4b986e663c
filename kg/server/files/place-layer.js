// Places in the colour of what they are believed to be, their names, and doors.
import { colourOf, drawText } from "/files/map-drawing.js";

export function drawPlaces(c, view) {
  for (const place of view.data.places.values()) drawPlace(c, view, place);
  c.strokeStyle = view.accent;
  c.lineWidth = 3;
  for (const door of view.data.doors) {
    c.beginPath();
    c.arc(...view.toScreen(door.x, door.y), 3, 0, 7);
    c.stroke();
  }
}

function drawPlace(c, view, place) {
  const selected = place.iri === view.selected, best = place.beliefs[0];
  c.beginPath();
  for (const ring of place.rings) {
    ring.forEach(([x, y], n) => { const [u, v] = view.toScreen(x, y); if (n) c.lineTo(u, v); else c.moveTo(u, v); });
    c.closePath();
  }
  c.fillStyle = c.strokeStyle = placeColour(view, place);
  c.globalAlpha = view.layers.viewed ? 0.05 : 0.06 + 0.16 * (best ? best[1] : 0);
  c.fill("evenodd");
  c.globalAlpha = selected ? 1 : 0.55;
  c.lineWidth = selected ? 3 : 1.2;
  c.stroke();
  c.globalAlpha = 1;
}

/** Names of places along their upper walls, where there is room. */
export function drawPlaceNames(c, view, taken) {
  c.textAlign = "center";
  c.font = "600 13px system-ui, sans-serif";
  for (const place of view.data.places.values()) {
    const name = nameOfPlace(view.data, place);
    const width = c.measureText(name).width;
    if (width > (place.xmax - place.xmin) * view.scale - 6) continue;
    const [u, v] = view.toScreen((place.xmin + place.xmax) / 2, place.ymax);
    const drop = [16, 32, 48].find((d) => taken.take(u - width / 2, v + d - 11, width, 14));
    if (drop) drawText(c, view, name, u, v + drop, placeColour(view, place));
  }
  c.textAlign = "left";
}

/** What a place is most probably, with its belief; else its name. */
export function nameOfPlace(data, place) {
  const best = place.beliefs[0];
  return best ? `${data.labelOf(best[0])} ${Math.round(best[1] * 100)} %` : data.nameOf(place);
}

export function placeColour(view, place) {
  const best = place.beliefs[0];
  return best ? colourOf(view.data.labelOf(best[0]), view.dark) : view.faint;
}
