// Highlights on the map: things, points and geometries of an answer.

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
