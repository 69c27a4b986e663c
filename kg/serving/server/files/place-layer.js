// Places in the colour of their most probable category, their names, and doors.
import { colourOf, drawText, inside } from "/files/map-drawing.js";

const LINES = 12; // of a place in which space for its name is searched

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

/** Names of places where there is room, preferably along the upper walls. */
export function drawPlaceNames(c, view, taken) {
  c.textAlign = "center";
  c.font = "600 13px system-ui, sans-serif";
  for (const place of view.data.places.values()) {
    for (const name of namesOf(view.data, place)) {
      const width = c.measureText(name).width;
      const spot = [...spotsOf(view, place, width)].find(([u, v]) => inside(...view.toMap(u, v - 5), place.rings)
        && taken.take(u - width / 2, v - 11, width, 14));
      if (!spot) continue;
      drawText(c, view, name, ...spot, placeColour(view, place));
      break;
    }
  }
  c.textAlign = "left";
}

/** Names of a place, long and short: its own name, or its most probable category; a number tells several kitchens apart. */
export function namesOf(data, place) {
  const best = place.beliefs[0], own = data.nameOf(place);
  if (!best) return [own];
  const kind = data.labelOf(best[0]), share = `${Math.round(best[1] * 100)} %`, number = /^place (\d+)$/.exec(own);
  if (!number) return [`${own} (${kind} ${share})`, own];
  const isOne = [...data.places.values()].filter((other) => other.beliefs[0]?.[0] === best[0]).length === 1;
  return isOne ? [`${kind} ${share}`, kind] : [`${kind} ${number[1]} (${share})`, `${kind} ${number[1]}`];
}

/** Possible centres of a name of this width [px] in a place's bounds, line by line from the top. */
function* spotsOf(view, place, width) {
  const [left, top] = view.toScreen(place.xmin, place.ymax), [right, bottom] = view.toScreen(place.xmax, place.ymin);
  if (right - left < width + 6) return;
  const aside = (right - left - width) / 2 - 6;
  for (let line = 0; line < LINES && top + 16 * line + 16 < bottom; line++) {
    for (const shift of [0, -aside, aside]) yield [(left + right) / 2 + shift, top + 16 * line + 16];
  }
}

export function placeColour(view, place) {
  const best = place.beliefs[0];
  return best ? colourOf(view.data.labelOf(best[0]), view.dark) : view.faint;
}
