// Highlights on the map: things, points and geometries of an answer; signs of changes.
import { tracePath } from "/files/map-drawing.js";

const RADIUS = 11; // [px] around a thing or point

export function drawHighlights(c, view) {
  const { iris, points, rings } = view.highlights;
  c.strokeStyle = view.accent;
  c.lineWidth = 3;
  for (const iri of iris) {
    const one = view.data.objects.get(iri), place = view.data.places.get(iri);
    if (one) ringAround(c, view, one.x, one.y);
    if (place) place.rings.forEach((ring) => outline(c, view, ring));
  }
  points.forEach(([x, y]) => ringAround(c, view, x, y));
  rings.forEach((ring) => outline(c, view, ring));
}

function ringAround(c, view, x, y) {
  c.beginPath();
  c.arc(...view.toScreen(x, y), RADIUS, 0, 7);
  c.stroke();
}

function outline(c, view, ring) {
  c.beginPath();
  ring.forEach(([x, y], n) => { const [u, v] = view.toScreen(x, y); if (n) c.lineTo(u, v); else c.moveTo(u, v); });
  c.stroke();
}

/** Signs of changes: a plus, a cross, or a line from the former to the present position. */
export function drawChanges(c, view) {
  c.strokeStyle = view.ink;
  c.lineWidth = 2;
  for (const { kind, was, now } of view.changes) {
    const [from, to] = [was, now].map((point) => point && view.toScreen(point[0], point[1]));
    if (kind === "appeared") cross(c, to, 0, RADIUS);
    if (kind === "gone") cross(c, from, RADIUS * 0.6, RADIUS * 0.6);
    if (kind === "moved") {
      tracePath(c, [from, to]);
      c.stroke();
      c.beginPath();
      c.arc(...from, 3, 0, 7);
      c.stroke();
    }
    if (kind === "moved" || kind === "relabelled") ringAround(c, view, now[0], now[1]);
  }
}

/** Two lines through a point, turned by 45 degrees if `across` is not 0. */
function cross(c, [u, v], across, along) {
  for (const [du, dv] of across ? [[along, across], [along, -across]] : [[along, 0], [0, along]]) {
    tracePath(c, [[u - du, v - dv], [u + du, v + dv]]);
    c.stroke();
  }
}
