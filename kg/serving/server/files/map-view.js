// The map on a canvas: the visible part, and the order of the layers.
import { FloorLayer } from "/files/floor-layer.js";
import { drawChanges, drawHighlights } from "/files/highlight-layer.js";
import { drawText, inside, Taken } from "/files/map-drawing.js";
import { listen } from "/files/map-gestures.js";
import { ObjectLayer } from "/files/object-layer.js";
import { drawPlaceNames, drawPlaces, namesOf, placeColour } from "/files/place-layer.js";
import { drawPlan, drawRobot, drawTrail } from "/files/robot-layer.js";
import { SurfaceLayer } from "/files/surface-layer.js";

const NEAR = 16; // [px] from a click to the thing that it selects
const REST = 150; // [ms] after the last movement until all names are drawn
const DARK = matchMedia("(prefers-color-scheme: dark)");

export class MapView {
  /** `shown(object)` returns whether an object is drawn. */
  constructor(canvas, data, shown) {
    this.canvas = canvas;
    this.data = data;
    this.shown = shown;
    this.layers = { surface: true, floor: true, viewed: false, labels: true, boxes: true, trail: true };
    this.selected = null; // IRI
    this.highlights = { iris: new Set(), points: [], rings: [] }; // of an answer; positions in metres
    this.changes = []; // of `/diff`, drawn as signs
    this.plan = null; // the answer of `/find`
    this.solid = null; // the view in three dimensions while it replaces this one
    this.scale = 40; // [px/m]
    this.centre = [0, 0]; // [m]
    this.isMoving = false;
    this.ink = this.faint = this.panel = this.accent = ""; // colours
    /** @type {(iri: string | null, point: number[]) => void} */
    this.onPick = () => {}; // called with (IRI or null, [x, y] in metres)
    this.onLost = () => {}; // called when the view in three dimensions has lost its graphics
    this._floor = new FloorLayer(this);
    this._objects = new ObjectLayer(this);
    this.surfaceLayer = new SurfaceLayer(this);
    this.onMove = () => {}; // called when another part of the map is shown
    this.isFitted = true; // whether all of the map is shown, as `fit` does
    this._fitted = false;
    listen(this);
    new ResizeObserver(() => this._resize()).observe(canvas);
    DARK.addEventListener("change", () => { this._objects.forgetColours(); this.draw(); });
    this._resize();
  }

  get dark() {
    return DARK.matches;
  }

  /** Request one drawing. */
  draw() {
    if (this.solid) return this.solid.draw();
    this._waiting ||= requestAnimationFrame(() => { this._waiting = 0; this._draw(); });
  }

  /** Show the whole map. */
  fit() {
    const bounds = this.bounds();
    if (!bounds) return;
    const [[xmin, ymin], [xmax, ymax]] = bounds;
    this.centre = [(xmin + xmax) / 2, (ymin + ymax) / 2];
    this.scale = Math.min((this.width - 60) / (xmax - xmin + 0.4), (this.height - 60) / (ymax - ymin + 0.4), 250);
    this._fitted = this.isFitted = true;
    this.onMove();
    this.solid?.fit();
    this.draw();
  }

  /** The lowest and the highest corner [m] of the map; null if it is empty. */
  bounds() {
    const points = [];
    for (const place of this.data.places.values()) for (const ring of place.rings) for (const corner of ring) points.push(corner);
    if (!points.length) {
      for (const tile of this.data.floor) points.push([tile.x, tile.y], [tile.x + tile.side * tile.size, tile.y + tile.side * tile.size]);
    }
    for (const one of this.data.objects.values()) if (this.shown(one)) points.push([one.x, one.y]);
    if (!points.length) return null;
    const [[xmin, xmax], [ymin, ymax]] = [boundsOf(points, 0), boundsOf(points, 1)];
    return [[xmin, ymin], [xmax, ymax]];
  }

  /** Centre a point [m]; without `z`, on the floor. */
  goTo(x, y, scale = Math.max(this.scale, 70), z) {
    this.centre = [x, y];
    this.scale = scale;
    this._moved();
    this.solid?.goTo(x, y, z);
    this.draw();
  }

  toScreen(x, y) {
    return [this.width / 2 + (x - this.centre[0]) * this.scale, this.height / 2 - (y - this.centre[1]) * this.scale];
  }

  toMap(u, v) {
    return [this.centre[0] + (u - this.width / 2) / this.scale, this.centre[1] - (v - this.height / 2) / this.scale];
  }

  zoom(factor, u = this.width / 2, v = this.height / 2) {
    if (this.solid) return this.solid.zoom(factor);
    const [x, y] = this.toMap(u, v);
    this.scale = Math.min(Math.max(this.scale * factor, 0.5), 800);
    this.centre = [x - (u - this.width / 2) / this.scale, y + (v - this.height / 2) / this.scale];
    this._moved();
    this._drawMoving();
  }

  /** Move the map by pixels. */
  pan(du, dv) {
    this.centre = [this.centre[0] - du / this.scale, this.centre[1] + dv / this.scale];
    this._moved();
    this._drawMoving();
  }

  /** Call `onPick` with the thing at a point of the canvas. */
  pick(u, v) {
    let best = null, least = NEAR;
    for (const one of this.data.objects.values()) {
      if (!this.shown(one)) continue;
      const [x, y] = this.toScreen(one.x, one.y);
      const distance = Math.hypot(x - u, y - v);
      if (distance < least) { least = distance; best = one.iri; }
    }
    const [x, y] = this.toMap(u, v);
    if (!best) for (const place of this.data.places.values()) if (inside(x, y, place.rings)) best = place.iri;
    this.onPick(best, [x, y]);
  }

  /** Colours and names that all views share. */
  readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "faint", "panel", "accent"]) this[name] = style.getPropertyValue(`--${name}`).trim();
  }

  colourOfClass(category) {
    return this._objects.colourOf(category);
  }

  colourOfPlace(place) {
    return placeColour(this, place);
  }

  nameOfPlace(place) {
    return namesOf(this.data, place)[0];
  }

  /** What is shown, as a PNG. */
  toBlob() {
    if (this.solid) return this.solid.toBlob();
    this._draw();
    return new Promise((done) => { this.canvas.toBlob(done, "image/png"); });
  }

  pictureOf(tile) {
    return this._floor.pictureOf(tile);
  }

  _moved() {
    this.isFitted = false;
    this.onMove();
  }

  /** Draw; most names follow when the map has stopped moving. */
  _drawMoving() {
    clearTimeout(this._rest);
    this.isMoving = true;
    this._rest = setTimeout(() => { this.isMoving = false; this.draw(); }, REST);
    this.draw();
  }

  _resize() {
    const box = this.canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
    this.width = box.width;
    this.height = box.height;
    this.canvas.width = Math.round(box.width * ratio);
    this.canvas.height = Math.round(box.height * ratio);
    if (!this.width) return; // hidden
    if (!this._fitted) this.fit();
    this.draw();
  }

  _draw() {
    const ratio = devicePixelRatio || 1, c = this.canvas.getContext("2d");
    this.readColours();
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.fillStyle = this.panel;
    c.fillRect(0, 0, this.width, this.height);
    const taken = new Taken(this.width, this.height);
    taken.take(this.width - 50, 0, 50, 180, true); // the buttons
    this._floor.draw(c);
    this.surfaceLayer.draw(c);
    drawPlaces(c, this);
    drawPlan(c, this, taken);
    this._objects.draw(c, taken);
    drawHighlights(c, this);
    drawChanges(c, this);
    drawTrail(c, this);
    drawRobot(c, this, taken);
    drawPlaceNames(c, this, taken);
    if (this.layers.labels) this._objects.drawNames(c, taken);
    this._drawScale(c);
  }

  _drawScale(c) {
    const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200].find((m) => m * this.scale > 60) || 500;
    const x = 14, y = this.height - 16, end = x + metres * this.scale;
    c.strokeStyle = this.ink;
    c.lineWidth = 2;
    c.beginPath();
    c.moveTo(x, y - 4);
    c.lineTo(x, y);
    c.lineTo(end, y);
    c.lineTo(end, y - 4);
    c.stroke();
    c.font = "12px system-ui, sans-serif";
    drawText(c, this, `${metres} m`, x + 6, y - 6, this.ink);
  }
}

function boundsOf(points, axis) {
  return points.reduce(([low, high], point) => [Math.min(low, point[axis]), Math.max(high, point[axis])], [Infinity, -Infinity]);
}
