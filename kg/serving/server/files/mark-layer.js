// Marks above the scene, of a constant width in pixels: robot, plan, highlights, changes, clusters, pictures, names.
import { drawText, footprintOf, shortened, spotsIn, Taken } from "/files/map-drawing.js";
import { radiusAt } from "/files/map-scene.js";
import { element } from "/files/page-elements.js";
import { pictureOf } from "/files/thing-panel.js";

const FAINT = 0.55; // opacity of the outlines of things without a name
const RADIUS = 11; // [px] around a thing or point
const REACH = 1.2; // [m] radius of the sector in the direction of view
const ARROW = [[0.25, 0], [-0.19, 0.17], [-0.1, 0], [-0.19, -0.17]]; // [m] of the robot, towards +x
const MIN_ARROW = 48; // [px/m] at which the robot is drawn at least
const MAX_NAMES = { flat: 400, solid: 60 }; // drawn at once
const TRIED = 1500; // objects for which space for a name is searched; fewer while the map moves
const CONFIDENT = { flat: 2.45, solid: 2.8 }; // deviations within which a position lies with 95 %, in two and three dimensions
const TEXT = "system-ui, sans-serif";
const MANY = 300; // things without a name that are not drawn while the map moves
const LEGIBLE = 18; // [px/m] from which on one of many objects has its name
const LETTERS = 28; // of a name that is drawn, at most
const CLOSE = 170; // [px/m] at and above which an object has its picture
const MAX_PICTURES = { shown: 12, kept: 300 };
const SIDES = [44, 110], WIDE = 0.3; // [px] of a picture, at least and at most; [m] within these limits
const BUTTONS = [[270, 0, 50], [52, -225, 225]]; // [px] above and below at the right: wide, from, high

export class MarkLayer {
  /** Marks of `view` (a MapView), on a canvas above its own that passes pointer events through. */
  constructor(view) {
    this._view = view;
    this.canvas = Object.assign(element("canvas"), { className: "marks", ariaHidden: "true" });
    this._c = this.canvas.getContext("2d");
    this._width = this._height = 0; // [px]
    this._ratio = 1; // pixels of the canvas in one of the page
    this._widths = new Map(); // of names [px]
    this._pictures = new Map(); // of objects by IRI; null without one
    this._names = []; // of objects that were drawn at rest: [object, u and v from its spot, font]
    this._failed = new Set(); // errors that were reported
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
    for (const [wide, from, to] of BUTTONS) this._taken.take(this._width - wide, from < 0 ? this._height + from : from, wide, to, true);
    const { data, layers, inFocus, clusters, plan, isMoving } = view;
    this._each(data.places.values(), (place) => this._drawOutline(place));
    this._each(data.doors, (door) => this._ring(this._at([door.x, door.y]), 3));
    if (layers.things && !inFocus && !clusters && !(isMoving && data.things.size > MANY)) this._each(data.things.values(), (one) => this._drawBox(one));
    if (!view.renderer && !clusters) this._each(view.drawn, (one) => this._dot([one.x, one.y, one.z], view.hexOfClass(one.class)));
    if (plan?.steps.length) this._each([plan], () => this._drawPlan(plan));
    this._each(view.highlights.iris, (iri) => this._drawHighlight(iri));
    this._each(view.highlights.points, (point) => this._ring(this._at(point), RADIUS));
    this._each(view.highlights.rings, (ring) => this._polygon(ring, { width: 3 }));
    this._each(view.changes, (change) => this._drawChange(change));
    for (const mark of [this._drawRobot, this._drawSelection, this._drawMeasure, this._drawSketch]) this._each([mark], () => mark.call(this));
    this._each(clusters || [], (cluster) => this._drawCluster(cluster));
    const area = (one) => (one.xmax - one.xmin) * (one.ymax - one.ymin);
    if (!inFocus) this._each([...data.places.values()].sort((a, b) => area(b) - area(a)), (place) => this._namePlace(place));
    if (!clusters) this._each([view], () => this._nameObjects());
    this._drawScale();
  }

  /** Draw each mark alone: one that fails is reported once, and the others are drawn. */
  _each(marks, draw) {
    for (const mark of marks) {
      try { draw(mark); } catch (error) {
        if (!this._failed.has(error.message)) reportError(error);
        this._failed.add(error.message);
      }
    }
  }

  /** The pixel of a point [m]: [u, v, scale], or null; without a height, on the floor. */
  _at(point) {
    const [x, y, z] = point;
    return this._view.toScreen(x, y, z);
  }

  /** Stroke the current path.
   * @param {{colour?: string, width?: number, dash?: number[], alpha?: number}} style */
  _stroke({ colour = this._view.accent, width = 2, dash = [], alpha = 1 }) {
    const c = this._c;
    Object.assign(c, { strokeStyle: colour, lineWidth: width, globalAlpha: alpha });
    c.setLineDash(dash);
    c.stroke();
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  /** Fill the current path. */
  _fill(colour, alpha = 1) {
    Object.assign(this._c, { fillStyle: colour, globalAlpha: alpha });
    this._c.fill();
    this._c.globalAlpha = 1;
  }

  /** Stroke a line through points [m]; a part behind the camera is left out. */
  _line(points, style = {}) {
    this._trace(points);
    this._stroke(style);
  }

  /** Stroke a ring of corners [m]. */
  _polygon(corners, style = {}) {
    this._line([...corners, corners[0]], style);
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

  _ring(spot, radius, style = {}) {
    if (!spot) return;
    this._c.beginPath();
    this._c.arc(spot[0], spot[1], radius, 0, 7);
    this._stroke({ width: 3, ...style });
  }

  _dot(point, colour, radius = 4) {
    const spot = this._at(point);
    if (!spot) return;
    this._c.beginPath();
    this._c.arc(spot[0], spot[1], radius, 0, 7);
    this._fill(colour);
  }

  /** The outline of a place: of the selected one, and of all where nothing else draws them. */
  _drawOutline(place) {
    const view = this._view, isChosen = place.iri === view.selected;
    if (!isChosen && view.renderer) return;
    for (const ring of place.rings) this._polygon(ring, { colour: isChosen ? view.accent : view.faint, width: isChosen ? 3 : 1.2 });
  }

  /** The faint outline of a thing without a name: its box, and from above its footprint. */
  _drawBox(one) {
    const { ink: colour, isFlat } = this._view, style = { colour, width: 1.2, dash: [3, 3], alpha: FAINT }, corners = footprintOf(one);
    const level = (z) => corners.map(([x, y]) => [x, y, z]), low = level(one.z - one.dz / 2), high = level(one.z + one.dz / 2);
    this._polygon(high, style);
    if (isFlat) return;
    this._polygon(low, style);
    low.forEach((corner, n) => this._line([corner, high[n]], style));
  }

  /** The steps of a plan: the way, directions of view, order. */
  _drawPlan(plan) {
    const { accent, panel } = this._view;
    this._line([plan.start, ...plan.steps.flatMap((step) => [...(step.way || []), [step.x, step.y]])], { dash: [7, 5] });
    for (const step of plan.steps) {
      const half = Math.min(step.extent, 6.28) / 2, turns = Array.from({ length: 13 }, (_, n) => step.heading + half * (n - 6) / 6);
      this._trace([[step.x, step.y], ...turns.map((angle) => [step.x + REACH * Math.cos(angle), step.y + REACH * Math.sin(angle)])]);
      this._fill(accent, 0.18);
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
    c.beginPath();
    c.roundRect(u - half, v - 10, 2 * half, 20, 10);
    this._fill(colour);
    c.fillStyle = ink;
    c.fillText(text, u, v + 4);
    c.textAlign = "left";
  }

  /** A ring around a thing or place of an answer. */
  _drawHighlight(iri) {
    const { data } = this._view, one = data.thingAt(iri);
    if (one) this._ring(this._at([one.x, one.y, one.z]), RADIUS);
    data.places.get(iri)?.rings.forEach((ring) => this._polygon(ring, { width: 3 }));
  }

  /** The sign of a change: a plus, a cross, or a line from the former to the present position. */
  _drawChange({ kind, was, now }) {
    const colour = this._view.ink;
    if (kind === "appeared") this._cross(this._at(now), 0, RADIUS);
    if (kind === "gone") this._cross(this._at(was), RADIUS * 0.6, RADIUS * 0.6);
    if (kind === "moved") {
      this._line([was, now], { colour });
      this._ring(this._at(was), 3, { colour, width: 2 });
    }
    if (kind === "moved" || kind === "relabelled") this._ring(this._at(now), RADIUS, { colour, width: 2 });
  }

  /** The preview of an edit: its points so far, and a line to the pointer. */
  _drawSketch() {
    const { sketch, accent } = this._view;
    if (!sketch) return;
    const points = [...sketch.points, ...(sketch.cursor ? [sketch.cursor] : [])];
    const isClosed = sketch.isArea && points.length > 2;
    this._line(isClosed ? [...points, points[0]] : points, { width: 3, dash: [8, 5] });
    points.forEach((point) => this._dot(point, accent, 5));
  }

  /** Two lines through a pixel, turned by 45 degrees if `across` is not 0. */
  _cross(spot, across, along) {
    const c = this._c;
    if (!spot) return;
    c.beginPath();
    for (const [du, dv] of across ? [[along, across], [along, -across]] : [[along, 0], [0, along]]) {
      c.moveTo(spot[0] - du, spot[1] - dv);
      c.lineTo(spot[0] + du, spot[1] + dv);
    }
    this._stroke({ colour: this._view.ink });
  }

  _drawRobot() {
    const { data: { robot, trail }, layers, accent, panel } = this._view;
    if (layers.trail && trail.length > 1) this._line(trail, { alpha: 0.5 });
    const spot = robot && this._at([robot.x, robot.y]);
    if (!spot) return;
    const grown = Math.max(1, MIN_ARROW / spot[2]), [cos, sin] = [Math.cos(robot.heading) * grown, Math.sin(robot.heading) * grown];
    this._trace(ARROW.map(([x, y]) => [robot.x + x * cos - y * sin, robot.y + x * sin + y * cos]));
    this._c.closePath();
    this._stroke({ colour: panel });
    this._fill(accent);
    this._taken.take(spot[0] - 11, spot[1] - 11, 22, 22, true);
  }

  /** Rings around the selected object: a small one, and one that holds its position with 95 %. */
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
  _drawCluster({ x, y, count, one, spot }) {
    const { ink, panel } = this._view;
    if (spot[0] < -20 || spot[1] < -20 || spot[0] > this._width + 20 || spot[1] > this._height + 20) return;
    if (count === 1) this._dot([x, y], this._view.hexOfClass(one.class));
    else this._pill(String(count), spot, ink, panel);
  }

  /** The ends of a measurement, and the distance between them. */
  _drawMeasure() {
    const { measured, ink, panel } = this._view;
    if (!measured.length) return;
    measured.forEach((point) => this._dot(point, ink));
    if (measured.length < 2) return;
    this._line(measured, { colour: panel, width: 5 });
    this._line(measured, { colour: ink, width: 2 });
    const [a, b] = measured.map((point) => this._at(point));
    if (a && b) this._pill(`${this._view.distance().toFixed(2)} m`, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2 - 16], ink, panel);
  }

  /** The name of a place, as sentences have it or shorter, where there is room. */
  _namePlace(place) {
    const view = this._view, title = view.data.nameOf(place), short = title.replace(/ \(.*\)$/, "");
    for (const name of new Set([title, short, shortened(short, LETTERS), shortened(short, LETTERS / 2)])) {
      const width = this._widthOf(name, "600 13px"), middle = [(place.xmin + place.xmax) / 2, (place.ymin + place.ymax) / 2];
      const spots = view.isFlat ? [...spotsIn(view, place, width)] : this._beside(this._at(middle), width);
      const spot = spots.find(([u, v]) => this._taken.take(u - width / 2 - 2, v - 12, width + 4, 16));
      if (!spot) continue;
      this._c.font = `600 13px ${TEXT}`;
      drawText(this._c, view, name, spot[0] - width / 2, spot[1], view.faint);
      return;
    }
  }

  /** The first of some spots [u, v] in three dimensions whose text of a width [px] would cross no ring. */
  _beside(middle, width) {
    const { highlights, selected, data } = this._view, rings = [...highlights.iris, selected].map((iri) => data.thingAt(iri)).map((one) => one && this._at([one.x, one.y, one.z])).filter(Boolean);
    const isFree = ([u, v]) => rings.every(([x, y]) => Math.abs(x - u) > width / 2 + RADIUS || Math.abs(y + 4 - v) > 8 + RADIUS);
    return middle ? [0, 28, -28, 56, -56].map((down) => [middle[0], middle[1] + down]).filter(isFree) : [];
  }

  /** Names and pictures of objects where there is room: the selected one first, then the surest or the nearest.
   *
   * While the map moves, the names that were drawn at rest move with their objects. */
  _nameObjects() {
    const view = this._view, { isFlat, isMoving, layers, inFocus, selected } = view, most = MAX_NAMES[isFlat ? "flat" : "solid"];
    if (isMoving && this._names.length) {
      this._drawPictures(this._onScreen(TRIED / 8));
      return this._each(this._names, (name) => this._drawName(name));
    }
    const found = this._onScreen(isMoving ? TRIED / 8 : Infinity);
    for (const { spot } of found.slice(0, isFlat ? TRIED : 0)) this._taken.take(spot[0] - 5, spot[1] - 5, 10, 10, true);
    this._drawPictures(found);
    this._names = [];
    return this._each(found.slice(0, TRIED), ({ one, spot: [u, v, scale] }) => {
      const isChosen = one.iri === selected;
      if (!isChosen && scale < LEGIBLE && view.drawn.length > MANY) return;
      if (this._names.length >= most || (!isChosen && (!layers.labels || inFocus))) return;
      const font = isChosen ? "700 13px" : "12px", text = shortened(view.data.partsOf(one)[0], LETTERS), width = this._widthOf(text, font), far = 2 + radiusAt(scale);
      const spots = isFlat ? [[far, 4], [-far - width, 4], [-width / 2, -10], [-width / 2, 20]] : [[-width / 2, -7]];
      const place = spots.find(([x, y]) => this._taken.take(u + x - 1, v + y - 11, width + 2, 14));
      if (!place) return;
      this._names.push({ one, text, font, place });
      this._drawName(this._names.at(-1));
    });
  }

  _drawName({ one, text, font, place: [x, y] }) {
    const view = this._view, spot = this._topOf(one);
    if (!spot) return;
    this._c.font = `${font} ${TEXT}`;
    drawText(this._c, view, text, spot[0] + x, spot[1] + y, view.ink, view.isFlat ? Math.max(one.existence, 0.75) : 1);
  }

  /** The pictures of objects {one, spot} above them: of the selected one first, and of those that are near. */
  _drawPictures(found) {
    const { layers, selected, inFocus } = this._view, c = this._c;
    const near = found.filter(({ one, spot }) => (one.iri === selected ? layers.chosen : layers.pictures && !inFocus && spot[2] >= CLOSE));
    let shown = 0;
    for (const { one, spot: [u, v, scale] } of near) {
      if (shown >= MAX_PICTURES.shown) break;
      const picture = this._pictureOf(one);
      if (!picture) continue;
      const side = Math.min(Math.max(WIDE * scale, SIDES[0]), SIDES[1]), factor = side / Math.max(picture.height, picture.width / 2);
      const [wide, high] = [picture.width * factor, picture.height * factor], [x, y] = [u - wide / 2, v - high - 26];
      if (!this._taken.take(x - 2, y - 2, wide + 4, high + 4)) continue;
      c.fillStyle = this._view.hexOfClass(one.class);
      c.fillRect(x - 2, y - 2, wide + 4, high + 4);
      c.fillRect(u - 1, y + high, 2, 10);
      c.drawImage(picture, x, y, wide, high);
      shown++;
    }
  }

  /** The picture of an object; null until it is read, in the past, and where none is kept. */
  _pictureOf({ iri }) {
    const { data, isMoving } = this._view, kept = this._pictures;
    if (data.past !== null) return null;
    if (!kept.has(iri) && !isMoving) {
      if (kept.size >= MAX_PICTURES.kept) kept.clear();
      kept.set(iri, null);
      pictureOf(data, iri).then((picture) => { kept.set(iri, picture); if (picture) this._view.draw(); }, () => {});
    }
    return kept.get(iri) ?? null;
  }

  /** The pixel at which an object is named: its middle, in three dimensions the top of its box. */
  _topOf(one) {
    const { isFlat, layers } = this._view;
    return this._at([one.x, one.y, (one.z ?? 0) + (isFlat || !layers.boxes ? 0 : (one.dz || 0) / 2)]);
  }

  /** The shown objects on the canvas, in the order in which they are named: {one, spot}, with the top of their boxes. */
  _onScreen(most) {
    const { drawn, isFlat, selected } = this._view, found = [];
    for (const one of drawn) {
      const spot = this._topOf(one);
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
    c.beginPath();
    [[x, y - 4], [x, y], [end, y], [end, y - 4]].forEach(([u, v]) => c.lineTo(u, v));
    this._stroke({ colour: view.ink });
    c.font = `12px ${TEXT}`;
    drawText(c, view, `${metres} m`, x + 6, y - 6, view.ink);
  }
}
