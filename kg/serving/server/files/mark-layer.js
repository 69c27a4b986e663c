// Marks above the scene, of a constant width in pixels: robot, plan, highlights, changes, clusters, pictures, names.
import { drawText, footprintOf, Taken } from "/files/map-drawing.js";
import { radiusAt } from "/files/map-scene.js";
import { ObjectPictures } from "/files/object-pictures.js";
import { namesOf, spotsIn } from "/files/place-names.js";

const FAINT = 0.55; // opacity of the outlines of things without a name
const RADIUS = 11; // [px] around a thing or point
const REACH = 1.2; // [m] radius of the sector in the direction of view
const ARROW = [[0.25, 0], [-0.19, 0.17], [-0.1, 0], [-0.19, -0.17]]; // [m] of the robot, towards +x
const MIN_ARROW = 48; // [px/m] at which the robot is drawn at least
const MAX_NAMES = { flat: 400, solid: 60 }; // drawn at once
const TRIED = 1500; // objects for which space for a name is searched; fewer while the map moves
const CONFIDENT = { flat: 2.45, solid: 2.8 }; // deviations within which a position lies with 95 %, in two and three dimensions
const TEXT = "system-ui, sans-serif";

export class MarkLayer {
  /** Marks of `view` (a MapView), on a canvas above its own that passes pointer events through. */
  constructor(view) {
    this._view = view;
    this.canvas = document.createElement("canvas");
    this.canvas.className = "marks";
    this.canvas.setAttribute("aria-hidden", "true");
    this._c = this.canvas.getContext("2d");
    this._width = this._height = 0; // [px]
    this._ratio = 1; // pixels of the canvas in one of the page
    this._widths = new Map(); // of names [px]
    this._pictures = new ObjectPictures(view);
  }

  resize(width, height, ratio) {
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    Object.assign(this.canvas.style, { width: `${width}px`, height: `${height}px`, left: `${this._view.canvas.offsetLeft}px`, top: `${this._view.canvas.offsetTop}px` });
    [this._width, this._height, this._ratio] = [width, height, ratio];
  }

  draw() {
    const { _c: c, _view: view } = this;
    c.setTransform(this._ratio, 0, 0, this._ratio, 0, 0);
    c.clearRect(0, 0, this._width, this._height);
    this._taken = new Taken(this._width, this._height);
    this._taken.take(this._width - 50, 0, 50, 270, true); // the buttons
    this._drawOutlines();
    if (view.layers.things && !view.inFocus && !view.clusters) for (const one of view.data.things.values()) this._drawBox(one);
    if (!view.hasGraphics && !view.clusters) for (const one of view.drawn) this._dot(one.x, one.y, one.z, view.hexOfClass(one.class));
    this._drawPlan();
    this._drawHighlights();
    this._drawChanges();
    this._drawRobot();
    this._drawSelection();
    this._drawClusters();
    this._drawMeasure();
    if (!view.inFocus) this._namePlaces();
    if (!view.clusters) this._nameObjects();
    this._drawScale();
  }

  /** The pixel of a point [m]: [u, v, scale], or null; without a height, on the floor. */
  _at(point) {
    const [x, y, z] = point;
    return this._view.toScreen(x, y, z);
  }

  /** Stroke a line through points [m]; a part behind the camera is left out. */
  _line(points, { colour = this._view.accent, width = 2, dash = [], isClosed = false, alpha = 1 } = {}) {
    const c = this._c;
    this._trace(isClosed ? [...points, points[0]] : points);
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.globalAlpha = alpha;
    c.setLineDash(dash);
    c.stroke();
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  _trace(points) {
    let isDown = false;
    this._c.beginPath();
    for (const point of points) {
      const spot = this._at(point);
      if (spot) this._c[isDown ? "lineTo" : "moveTo"](spot[0], spot[1]);
      isDown = Boolean(spot);
    }
  }

  _ring(spot, radius, { colour = this._view.accent, width = 3, dash = [] } = {}) {
    const c = this._c;
    if (!spot) return;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.setLineDash(dash);
    c.beginPath();
    c.arc(spot[0], spot[1], radius, 0, 7);
    c.stroke();
    c.setLineDash([]);
  }

  _dot(x, y, z, colour, radius = 4) {
    const spot = this._at([x, y, z]), c = this._c;
    if (!spot) return;
    c.fillStyle = colour;
    c.beginPath();
    c.arc(spot[0], spot[1], radius, 0, 7);
    c.fill();
  }

  /** The selected place; all places where nothing else draws them; doors. */
  _drawOutlines() {
    const view = this._view;
    for (const place of view.data.places.values()) {
      const isChosen = place.iri === view.selected;
      if (!isChosen && view.hasGraphics) continue;
      for (const ring of place.rings) this._line(ring, { colour: view.colourOfPlace(place), width: isChosen ? 3 : 1.2, isClosed: true });
    }
    for (const door of view.data.doors) this._ring(this._at([door.x, door.y]), 3);
  }

  /** The faint outline of a thing without a name: its box, and from above its footprint. */
  _drawBox(one) {
    const { ink: colour, isFlat } = this._view, style = { colour, width: 1.2, dash: [3, 3], alpha: FAINT }, corners = footprintOf(one);
    const level = (z) => corners.map(([x, y]) => [x, y, z]), low = level(one.z - one.dz / 2), high = level(one.z + one.dz / 2);
    this._line(high, { ...style, isClosed: true });
    if (isFlat) return;
    this._line(low, { ...style, isClosed: true });
    low.forEach((corner, n) => this._line([corner, high[n]], style));
  }

  /** The steps of a plan: the way, directions of view, order. */
  _drawPlan() {
    const { plan, accent, panel } = this._view, c = this._c;
    if (!plan) return;
    this._line([plan.start, ...plan.steps.flatMap((step) => [...(step.way || []), [step.x, step.y]])], { dash: [7, 5] });
    for (const step of plan.steps) {
      const half = Math.min(step.extent, 6.28) / 2, turns = Array.from({ length: 13 }, (_, n) => step.heading + half * (n - 6) / 6);
      this._trace([[step.x, step.y], ...turns.map((angle) => [step.x + REACH * Math.cos(angle), step.y + REACH * Math.sin(angle)])]);
      c.fillStyle = accent;
      c.globalAlpha = 0.18;
      c.fill();
      c.globalAlpha = 1;
    }
    const stops = new Map(); // positions once, with the numbers of their steps
    plan.steps.forEach((step, n) => {
      const spot = this._at([step.x, step.y]), key = spot?.slice(0, 2).map(Math.round).join();
      if (spot) stops.set(key, [spot, [...(stops.get(key)?.[1] ?? []), n + 1]]);
    });
    for (const [spot, numbers] of stops.values()) this._pill(numbers.join(", "), spot, accent, panel);
  }

  /** A text in a rounded box around a pixel. */
  _pill(text, [u, v], colour, ink) {
    const c = this._c;
    c.font = `600 12px ${TEXT}`;
    c.textAlign = "center";
    const half = Math.max(c.measureText(text).width / 2 + 6, 10);
    this._taken.take(u - half, v - 10, 2 * half, 20, true);
    c.fillStyle = colour;
    c.beginPath();
    c.roundRect(u - half, v - 10, 2 * half, 20, 10);
    c.fill();
    c.fillStyle = ink;
    c.fillText(text, u, v + 4);
    c.textAlign = "left";
  }

  /** Rings around the things, points and geometries of an answer. */
  _drawHighlights() {
    const { highlights: { iris, points, rings }, data } = this._view;
    for (const iri of iris) {
      const one = data.thingAt(iri);
      if (one) this._ring(this._at([one.x, one.y, one.z]), RADIUS);
      data.places.get(iri)?.rings.forEach((ring) => this._line(ring, { width: 3, isClosed: true }));
    }
    points.forEach((point) => this._ring(this._at(point), RADIUS));
    rings.forEach((ring) => this._line(ring, { width: 3, isClosed: true }));
  }

  /** Signs of changes: a plus, a cross, or a line from the former to the present position. */
  _drawChanges() {
    const { changes, ink: colour } = this._view;
    for (const { kind, was, now } of changes) {
      if (kind === "appeared") this._cross(this._at(now), 0, RADIUS);
      if (kind === "gone") this._cross(this._at(was), RADIUS * 0.6, RADIUS * 0.6);
      if (kind === "moved") {
        this._line([was, now], { colour });
        this._ring(this._at(was), 3, { colour, width: 2 });
      }
      if (kind === "moved" || kind === "relabelled") this._ring(this._at(now), RADIUS, { colour, width: 2 });
    }
  }

  /** Two lines through a pixel, turned by 45 degrees if `across` is not 0. */
  _cross(spot, across, along) {
    const c = this._c;
    if (!spot) return;
    c.strokeStyle = this._view.ink;
    c.lineWidth = 2;
    c.beginPath();
    for (const [du, dv] of across ? [[along, across], [along, -across]] : [[along, 0], [0, along]]) {
      c.moveTo(spot[0] - du, spot[1] - dv);
      c.lineTo(spot[0] + du, spot[1] + dv);
    }
    c.stroke();
  }

  _drawRobot() {
    const { data: { robot, trail }, layers, accent, panel } = this._view, c = this._c;
    if (layers.trail && trail.length > 1) this._line(trail, { alpha: 0.5 });
    const spot = robot && this._at([robot.x, robot.y]);
    if (!spot) return;
    const grown = Math.max(1, MIN_ARROW / spot[2]), [cos, sin] = [Math.cos(robot.heading) * grown, Math.sin(robot.heading) * grown];
    this._trace(ARROW.map(([x, y]) => [robot.x + x * cos - y * sin, robot.y + x * sin + y * cos]));
    c.closePath();
    c.fillStyle = accent;
    c.strokeStyle = panel;
    c.lineWidth = 2;
    c.stroke();
    c.fill();
    this._taken.take(spot[0] - 11, spot[1] - 11, 22, 22, true);
  }

  /** Rings around the selected object: a small one, and one that holds its position with a probability of 95 %. */
  _drawSelection() {
    const view = this._view, one = view.data.thingAt(view.selected), spot = one && this._at([one.x, one.y, one.z]);
    if (!spot) return;
    const radius = radiusAt(spot[2]), colour = view.ink;
    this._ring(spot, radius + 4, { colour, width: 2 });
    if (!one.deviation) return;
    const wide = CONFIDENT[view.isFlat ? "flat" : "solid"] * one.deviation * spot[2];
    this._ring(spot, Math.max(wide, radius), { colour, width: 1, dash: [4, 4] });
  }

  /** A circle with its number for many objects, a dot for one. */
  _drawClusters() {
    const { clusters, ink, panel } = this._view;
    for (const { x, y, count, one, spot } of clusters || []) {
      if (spot[0] < -20 || spot[1] < -20 || spot[0] > this._width + 20 || spot[1] > this._height + 20) continue;
      if (count === 1) this._dot(x, y, undefined, this._view.hexOfClass(one.class));
      else this._pill(String(count), spot, ink, panel);
    }
  }

  /** The ends of a measurement, and the distance between them. */
  _drawMeasure() {
    const { measured, ink, panel } = this._view;
    if (!measured.length) return;
    measured.forEach((point) => this._dot(...point, ink));
    if (measured.length < 2) return;
    this._line(measured, { colour: panel, width: 5 });
    this._line(measured, { colour: ink, width: 2 });
    const [a, b] = measured.map((point) => this._at(point));
    if (a && b) this._pill(`${this._view.distance().toFixed(2)} m`, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2 - 16], ink, panel);
  }

  /** Names of places, the largest first, where there is room. */
  _namePlaces() {
    const view = this._view, c = this._c, area = (one) => (one.xmax - one.xmin) * (one.ymax - one.ymin);
    c.font = `600 13px ${TEXT}`;
    for (const place of [...view.data.places.values()].sort((a, b) => area(b) - area(a))) {
      for (const name of namesOf(view.data, place)) {
        const width = this._widthOf(name, "600 13px"), middle = [(place.xmin + place.xmax) / 2, (place.ymin + place.ymax) / 2];
        const spots = view.isFlat ? [...spotsIn(view, place, width)] : [this._at(middle)].filter(Boolean);
        const spot = spots.find(([u, v]) => this._taken.take(u - width / 2 - 2, v - 12, width + 4, 16));
        if (!spot) continue;
        drawText(c, view, name, spot[0] - width / 2, spot[1], view.colourOfPlace(place));
        break;
      }
    }
  }

  /** Names and pictures of objects where there is room: the selected one first, then the surest or the nearest. */
  _nameObjects() {
    const view = this._view, c = this._c, { isFlat, isMoving, layers, inFocus } = view;
    const most = MAX_NAMES[isFlat ? "flat" : "solid"], tried = isMoving ? TRIED / 8 : TRIED;
    const found = this._onScreen(isMoving && view.drawn.length > TRIED ? tried : Infinity);
    for (const { spot } of found.slice(0, isFlat ? TRIED : 0)) this._taken.take(spot[0] - 5, spot[1] - 5, 10, 10, true);
    this._pictures.draw(c, this._taken, found);
    let drawn = 0;
    for (const { one, spot: [u, v, scale] } of found.slice(0, tried)) {
      if (drawn >= (isMoving ? most / 2 : most)) break;
      const isChosen = one.iri === view.selected;
      if (!isChosen && (!layers.labels || inFocus)) continue;
      const font = isChosen ? "700 13px" : "12px", name = view.data.nameOf(one).slice(0, 40), width = this._widthOf(name, font), far = 2 + radiusAt(scale);
      const spots = isFlat ? [[u + far, v + 4], [u - far - width, v + 4], [u - width / 2, v - 10], [u - width / 2, v + 20]] : [[u - width / 2, v - 7]];
      const place = spots.find(([x, y]) => this._taken.take(x - 1, y - 11, width + 2, 14));
      if (!place) continue;
      c.font = `${font} ${TEXT}`;
      drawText(c, view, name, ...place, view.ink, isFlat ? Math.max(one.existence, 0.75) : 1);
      drawn++;
    }
  }

  /** The shown objects on the canvas, in the order in which they are named: {one, spot}, with the top of their boxes. */
  _onScreen(most) {
    const { drawn, isFlat, layers, selected } = this._view, found = [];
    for (const one of drawn) {
      const high = isFlat || !layers.boxes ? 0 : (one.dz || 0) / 2, spot = this._at([one.x, one.y, (one.z ?? 0) + high]);
      if (spot && spot[0] > -5 && spot[1] > -5 && spot[0] < this._width + 5 && spot[1] < this._height + 5) found.push({ one, spot });
      if (found.length >= most) break;
    }
    if (!isFlat) found.sort((a, b) => Number(b.one.iri === selected) - Number(a.one.iri === selected) || b.spot[2] - a.spot[2]);
    return found;
  }

  _widthOf(name, font) {
    const key = `${font} ${name}`;
    if (!this._widths.has(key)) {
      if (this._widths.size > 20000) this._widths.clear();
      this._c.font = `${font} ${TEXT}`;
      this._widths.set(key, this._c.measureText(name).width);
    }
    return this._widths.get(key);
  }

  /** A bar of a round length; in three dimensions lengths depend on the distance. */
  _drawScale() {
    const view = this._view, c = this._c;
    if (!view.isFlat) return;
    const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200].find((m) => m * view.scale > 60) || 500;
    const x = 14, y = this._height - 16, end = x + metres * view.scale;
    c.strokeStyle = view.ink;
    c.lineWidth = 2;
    c.beginPath();
    [[x, y - 4], [x, y], [end, y], [end, y - 4]].forEach(([u, v]) => c.lineTo(u, v));
    c.stroke();
    c.font = `12px ${TEXT}`;
    drawText(c, view, `${metres} m`, x + 6, y - 6, view.ink);
  }
}
