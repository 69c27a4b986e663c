// The map, flat or in three dimensions: one scene, one camera, and marks with names above them.
import { MapCamera } from "/files/map-camera.js";
import { clustersOf, colourOf, footprintOf, inside } from "/files/map-drawing.js";
import { MarkLayer } from "/files/mark-layer.js";
import { hexOf, MANY, MapScene } from "/files/map-scene.js";
import { drawing, element } from "/files/page-elements.js";
import * as THREE from "/files/vendor/three.min.js";

const NEAR = 16; // [px] from a click to the thing that it selects
const HOVER = 50; // [ms] from one look under the pointer to the next
const REST = 150; // [ms] after the last movement until all names are drawn, and after the last change until edges are smooth
const SMOOTH = 2; // pixels along the side of one of the screen, at rest: many machines draw in software
const [QUICK, SLOW, PAUSE] = [25, 45, 1000]; // [ms] from one drawing to the next; after a pause nothing is measured
const LEAST = 0.02; // of the voxels, while the map moves
const HIGH = 1; // [m] above the floor that must fit on the canvas
const FADED = 0.12; // strength of what is not in focus
const CUT = { surface: 2, walls: 0.5 }; // [m] above the floor, unless another height is chosen
const CLOSE = { flat: 70, solid: 150 }; // [px/m] at least, for a thing that is gone to
const NO_GRAPHICS = "This browser draws no WebGL 2: outlines and names only. All things are listed beside the map.";
const LOST = "The browser released its graphics memory: outlines and names only, until it gives some back.";
const DARK = matchMedia("(prefers-color-scheme: dark)");

export class MapView {
  /** `shown(object)` returns whether an object is drawn. */
  constructor(canvas, data, shown) {
    this.canvas = canvas;
    this.data = data;
    this.shown = shown;
    this.layers = { surface: true, floor: true, viewed: false, labels: true, boxes: true, trail: true, pictures: true, chosen: true, things: true };
    this.selected = null; // IRI
    this.isFocused = false; // whether everything else is faded
    this.highlights = { iris: new Set(), points: [], rings: [] }; // of an answer; positions in metres
    this.changes = []; // of `/diff`, drawn as signs
    this.plan = null; // the answer of `/find`
    this.measured = []; // points [m] of a measurement, at most two
    this.sketch = null; // preview of an edit: {points [m], cursor, isArea}
    this.height = null; // [m] above the floor at which walls are cut; null: by what there is
    this._renderer = null;
    this.drawn = []; // the shown objects, the surest first
    this.clusters = null; // objects drawn together, at low zoom
    this.isMoving = false;
    this.share = 1; // of the voxels that are drawn while the map moves, as many as the machine can
    this._last = 0; // [ms] of the last drawing
    this._isStale = true; // whether more than the camera changed since the last drawing
    this.isFitted = true; // whether all of the map is shown, as `fit` does
    this.ink = this.faint = this.panel = this.accent = ""; // colours
    /** @type {(iri: string | null, point: number[]) => void} */
    this.onPick = () => {}; // called with (IRI or null, [x, y, z] in metres)
    this.onMove = () => {}; // called when another part of the map is shown
    this.onSurface = () => {}; // called when the surface was read
    this._colours = new Map(); // of categories
    this._wasFitted = false;
    this.camera = new MapCamera(canvas, { moved: () => this._moved(), clicked: (u, v) => this.pick(u, v), fit: () => this.fit() });
    this.scene = new MapScene(this);
    this._marks = new MarkLayer(this);
    this._note = element("p");
    this._note.className = "key hidden";
    canvas.after(this._marks.canvas, this._note);
    this._begin();
    new ResizeObserver(() => this._resize()).observe(canvas);
    canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => { this._hovering ??= setTimeout(() => { this._hovering = undefined; this._hover(offsetX, offsetY); }, HOVER); });
    DARK.addEventListener("change", () => { this._colours.clear(); this.draw(); });
    this._resize();
    this.scene.surface.current(); // read while the state of the map is
  }

  get dark() {
    return DARK.matches;
  }

  get isFlat() {
    return this.camera.isFlat;
  }

  /** [px/m] in the middle. */
  get scale() {
    return this.camera.state.scale;
  }

  /** [m] above the floor at which walls are cut. */
  get cut() {
    return this.height ?? (this.scene.surface.current() ? CUT.surface : CUT.walls);
  }

  /** The object in focus; null without. */
  get inFocus() {
    return (this.isFocused && this.data.objects.get(this.selected)) || null;
  }

  /** Request one drawing, with all changes. */
  draw() {
    this._isStale = true;
    this._render();
  }

  /** Show the whole map. */
  fit() {
    const bounds = this.bounds();
    if (!bounds) return;
    const [[xmin, ymin], [xmax, ymax]] = bounds;
    if (!this._wasFitted) this.camera.origin = [(xmin + xmax) / 2, (ymin + ymax) / 2];
    this._wasFitted = true;
    this.camera.fit(bounds, this.data.ground(), HIGH, [...this.data.places.values()].flatMap(({ rings }) => rings[0]));
    this.isFitted = true;
    this.onMove();
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
    return [Math.min, Math.max].map((outer) => [0, 1].map((k) => points.reduce((most, point) => outer(most, point[k]), points[0][k])));
  }

  /** Centre a point [m], as far as the flat map has something there; without `z`, on the floor. */
  goTo(x, y, scale = Math.max(this.scale, CLOSE[this.isFlat ? "flat" : "solid"]), z = this.data.ground()) {
    const bounds = this.isFlat && this.bounds(), [u, v] = bounds ? this.camera.within(bounds, [x, y], scale) : [x, y];
    this.camera.look({ x: u, y: v, z, scale });
  }

  /** Fade everything but the selected object and fly to it, or end that; `stays`: without the flight. */
  focus(isFocused, { stays = false } = {}) {
    this.isFocused = isFocused;
    const one = this.inFocus;
    if (one && !stays) {
      const wide = Math.max(one.dx || 0, one.dy || 0, one.dz || 0, 0.4);
      this.camera.fly({ x: one.x, y: one.y, z: one.z ?? 0, scale: Math.min(this.camera.width, this.camera.height) / (3 * wide) });
    }
    this.draw();
  }

  /** Change between the flat view and three dimensions. */
  turn() {
    const wasFitted = this.isFitted;
    this.camera.turn();
    if (wasFitted) this.fit();
    this.draw();
  }

  /** The measured distance [m]: between two points of the room, or of the flat map. */
  distance() {
    const [a, b] = this.measured;
    return Math.hypot(b[0] - a[0], b[1] - a[1], this.isFlat ? 0 : b[2] - a[2]);
  }

  /** [u, v, scale]: the pixel of a point [m], and pixels a metre there; null behind the camera. */
  toScreen(x, y, z = this.data.ground()) {
    return this.camera.project(x, y, z);
  }

  /** Call `onPick` with the thing at a point of the canvas, or near it, or the place there. */
  pick(u, v) {
    const cluster = this.clusters?.find(({ spot }) => spot && Math.hypot(spot[0] - u, spot[1] - v) < NEAR);
    if (cluster?.count > 1) {
      this.camera.look({ x: cluster.x, y: cluster.y, scale: 4 * this.scale });
      return;
    }
    const met = this.scene.meet(u, v);
    if (!met) return; // the sky
    const near = this._nearest(u, v), one = this.isFlat ? near ?? met.thing : met.thing ?? near, [x, y] = met.point;
    const below = [...this.data.places.values()].filter((place) => inside(x, y, place.rings)).pop();
    this.onPick((one ?? this._unnamedAt([x, y], u, v) ?? below)?.iri ?? null, met.point);
  }

  _nearest(u, v) {
    let best = null, least = NEAR;
    for (const one of this.drawn) {
      const spot = this.toScreen(one.x, one.y, one.z ?? 0);
      const distance = spot ? Math.hypot(spot[0] - u, spot[1] - v) : Infinity;
      if (distance < least) { least = distance; best = one; }
    }
    return best;
  }

  /** The thing without a name, where they are shown, around a point of the flat map, or whose middle is near a pixel. */
  _unnamedAt([x, y], u, v) {
    if (!this.layers.things) return undefined;
    return [...this.data.things.values()].find((one) => {
      if (this.isFlat) return inside(x, y, [footprintOf(one)]);
      const spot = this.toScreen(one.x, one.y, one.z);
      return spot && Math.hypot(spot[0] - u, spot[1] - v) < NEAR;
    });
  }

  hexOfClass(category) {
    if (!this._colours.has(category)) this._colours.set(category, hexOf(colourOf(this.data.labelOf(category), this.dark)));
    return this._colours.get(category);
  }

  colourOfPlace(place) {
    const best = place.beliefs[0];
    return best ? this.hexOfClass(best[0]) : this.faint;
  }

  /** Name what is under the pointer, with its number, and move the end of a sketched line there. */
  _hover(u, v) {
    if (this.isMoving) return;
    const one = this._nearest(u, v);
    this.canvas.title = one ? this.data.nameOf(one) : "";
    if (!this.sketch) return;
    this.sketch.cursor = this.scene.meet(u, v)?.point.slice(0, 2) ?? null;
    this._render();
  }

  /** How strongly an object is drawn, by its existence; faint beside an object in focus. */
  strengthOf(one) {
    return this.inFocus && one.iri !== this.selected ? FADED : Math.max(one.existence, 0.2);
  }

  /** What is shown, as a PNG. */
  toBlob() {
    this._renderNow({ smooth: true });
    const { width, height } = this._marks.canvas, c = drawing(width, height);
    if (this._renderer) c.drawImage(this.canvas, 0, 0, width, height);
    c.drawImage(this._marks.canvas, 0, 0);
    return new Promise((done) => { c.canvas.toBlob(done, "image/png"); });
  }

  /** The renderer of three.js; null where only marks are drawn. */
  get renderer() {
    return this._isLost ? null : this._renderer;
  }

  /** Begin to draw with WebGL, where the browser has it. */
  _begin() {
    const context = this.canvas.getContext("webgl2", { antialias: false });
    if (!context) return this._say(NO_GRAPHICS);
    this._renderer = new THREE.WebGLRenderer({ canvas: this.canvas, context });
    this._renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this._renderer.localClippingEnabled = true;
    this.canvas.addEventListener("webglcontextlost", () => { this._isLost = true; this._say(LOST); this.draw(); });
    this.canvas.addEventListener("webglcontextrestored", () => { this._isLost = false; this._say(""); this.scene.forget(); this.draw(); });
    return undefined;
  }

  _say(text) {
    this._note.textContent = text;
    this._note.classList.toggle("hidden", !text);
  }

  /** After a movement, draw; most names follow when the map has stopped moving. */
  _moved() {
    this.isFitted = false;
    this.onMove();
    this.isMoving = true;
    this._render();
  }

  _resize() {
    const { clientWidth, clientHeight } = this.canvas, ratio = devicePixelRatio || 1;
    if (!clientWidth || !clientHeight) return; // hidden
    const wasFitted = this.isFitted;
    this._marks.resize(clientWidth, clientHeight, ratio);
    this._renderer?.setSize(clientWidth, clientHeight, false);
    this.camera.resize(clientWidth, clientHeight);
    this.isFitted = wasFitted;
    if (wasFitted) this.fit();
    this._renderNow(); // at once, since the canvas is empty now
    this._render();
  }

  /** Draw with the next frame of the screen, and smoothly when nothing changes any more. */
  _render() {
    clearTimeout(this._rest);
    this._rest = setTimeout(() => this._calm(), REST);
    this.canvas.dataset.drawn = "soon";
    this._waiting ||= requestAnimationFrame(() => { this._waiting = 0; this._renderNow(); });
  }

  /** Draw all names, and smoothly, once nothing moves and nobody drags. */
  _calm() {
    if (this.camera.isHeld) { this._rest = setTimeout(() => this._calm(), REST); return; }
    this.isMoving = false;
    cancelAnimationFrame(this._waiting); // on a busy machine the quick drawing would come last
    this._waiting = 0;
    this._renderNow({ smooth: true });
  }

  _renderNow({ smooth = false } = {}) {
    if (!this.data.version) return; // nothing was read yet
    if (this._isStale) this._update();
    this.clusters = clustersOf(this);
    if (this.renderer) {
      const ratio = devicePixelRatio || 1, wanted = smooth && this.drawn.length <= MANY ? Math.max(ratio, SMOOTH) : ratio;
      if (wanted !== this._renderer.getPixelRatio()) this._renderer.setPixelRatio(wanted);
      this._adjust();
      this.scene.adapt();
      this._renderer.render(this.scene.scene, this.camera.camera);
    }
    this._marks.draw();
    if (smooth) this.canvas.dataset.drawn = "smoothly";
  }

  /** Draw fewer voxels while the map moves slowly, and more again when it is quick. */
  _adjust() {
    const now = performance.now(), pause = now - this._last;
    this._last = now;
    if (!this.isMoving || this.isFlat || pause > PAUSE) return;
    if (pause > SLOW) this.share = Math.max(this.share / 1.5, LEAST);
    else if (pause < QUICK) this.share = Math.min(this.share * 1.1, 1);
  }

  _update() {
    this._isStale = false;
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "faint", "panel", "accent"]) this[name] = style.getPropertyValue(`--${name}`).trim();
    const { selected } = this, order = (one) => (one.iri === selected ? 2 : one.existence);
    const drawn = [...this.data.objects.values()].filter((one) => this.shown(one));
    if (drawn.length <= MANY) drawn.sort((a, b) => order(b) - order(a) || a.iri.length - b.iri.length || (a.iri < b.iri ? -1 : 1));
    const isSame = this.data.version === this._version && drawn.length === this.drawn.length && drawn.every((one, n) => one === this.drawn[n]);
    if (!isSame) this.drawn = drawn; // the same list is not drawn anew
    this._version = this.data.version;
    this.scene.update();
  }
}
