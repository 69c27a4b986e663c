// The map in three dimensions: camera, picking and names; data come from the flat map's view. Loaded at its first use.
import { boxOf, SolidScene } from "/files/map-3d-scene.js";
import { drawText, inside, Taken } from "/files/map-drawing.js";
import * as THREE from "/files/vendor/three.min.js";

const NEAR = 16; // [px] from a click to the thing that it selects
const STILL = 6; // [px] that a pointer may move during a click
const MANY = 2000; // with more objects, no names are drawn while the map moves
const REST = 150; // [ms] after the last movement until names are drawn
const NAMES = 60; // names of objects that are drawn: the selected and the nearest
const HIGH = 1; // [m] above the floor that must fit on the canvas
const SOUTH = new THREE.Vector3(0, -0.62, 0.78); // initial direction to the camera
const MAX_DISTANCE = 5; // [m] from the camera to a thing that is shown

export class Map3d {
  /** The same map as in `view`, a MapView. Throws an Error if the browser has no WebGL 2. */
  constructor(view) {
    this._view = view;
    this._canvas = document.createElement("canvas");
    this._names = document.createElement("canvas"); // above the other canvas; passes pointer events through
    this._names.className = "names";
    this._canvas.tabIndex = 0;
    this._canvas.id = "solid-canvas";
    this._canvas.setAttribute("role", "img");
    this._canvas.setAttribute("aria-label", "Map in three dimensions; arrow keys move, with shift they turn, plus and minus zoom, 0 shows all.");
    const context = this._canvas.getContext("webgl2", { antialias: true });
    if (!context) throw new Error("this browser has no WebGL 2");
    this._renderer = new THREE.WebGLRenderer({ canvas: this._canvas, context });
    this._camera = new THREE.PerspectiveCamera(45, 1, 0.05, 5000);
    this._camera.up.set(0, 0, 1);
    this._solid = new SolidScene(view, [...view.centre]);
    this._controls = new THREE.OrbitControls(this._camera, this._canvas);
    Object.assign(this._controls, { screenSpacePanning: false, maxPolarAngle: 1.53, minDistance: 0.4, maxDistance: 2000, zoomToCursor: true });
    this._controls.listenToKeyEvents(this._canvas);
    this._controls.addEventListener("change", () => this._renderMoving());
    this._width = this._height = 0; // [px]
    this._changed = true; // since the last drawing
    this._canvas.addEventListener("keydown", (event) => this._press(event));
    this._canvas.addEventListener("webglcontextlost", () => { if (this._canvas.isConnected) view.onLost(); });
    this._listenToClicks();
    new ResizeObserver(() => this._resize()).observe(this._canvas);
  }

  /** Replace the flat map. */
  open() {
    this._view.canvas.after(this._canvas, this._names);
    this._view.canvas.classList.add("hidden");
    this._resize();
  }

  close() {
    this._view.canvas.classList.remove("hidden");
    this._canvas.remove();
    this._names.remove();
  }

  /** Request one drawing with all changes. */
  draw() {
    this._changed = true;
    this._render();
  }

  /** Show the whole map from the south and above, as near as all corners fit on the canvas. */
  fit() {
    const bounds = this._view.bounds();
    if (!bounds) return;
    const [[xmin, ymin], [xmax, ymax]] = bounds, { target } = this._controls, { ground } = this._solid;
    const corners = [[xmin, ymin], [xmin, ymax], [xmax, ymin], [xmax, ymax]].flatMap(([x, y]) => [[x, y, ground], [x, y, ground + HIGH]]);
    target.copy(this._solid.at((xmin + xmax) / 2, (ymin + ymax) / 2));
    let far = 4 * Math.hypot(xmax - xmin, ymax - ymin) / Math.min(1, this._camera.aspect) + 4;
    this._camera.far = 20 * far;
    this._camera.updateProjectionMatrix();
    const fits = () => {
      this._camera.position.copy(target).addScaledVector(SOUTH, far);
      this._camera.lookAt(target);
      this._camera.updateMatrixWorld();
      return corners.every((corner) => this._project(...corner, 0.92));
    };
    while (far > 1 && fits()) far *= 0.95;
    far /= 0.95;
    fits();
    this._controls.update();
  }

  /** Centre a point [m], in the present direction of the camera. */
  goTo(x, y, z) {
    const { target } = this._controls, offset = this._camera.position.clone().sub(target);
    target.copy(this._solid.at(x, y, z));
    this._camera.position.copy(target).add(offset.setLength(Math.min(offset.length(), MAX_DISTANCE)));
    this._controls.update();
  }

  zoom(factor) {
    const { target } = this._controls;
    this._camera.position.sub(target).divideScalar(factor).add(target);
    this._controls.update();
  }

  _press(event) {
    const zooms = { "+": 1.25, "=": 1.25, "-": 0.8 };
    if (zooms[event.key]) this.zoom(zooms[event.key]);
    else if (event.key === "0") this.fit();
  }

  _listenToClicks() {
    let down = null;
    this._canvas.addEventListener("pointerdown", (event) => { down = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null; });
    this._canvas.addEventListener("pointerup", (event) => {
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > STILL) return;
      const box = this._canvas.getBoundingClientRect();
      this._pick(event.clientX - box.left, event.clientY - box.top);
    });
  }

  /** Call `onPick` with the thing at a point of the canvas: an object there or near it, or the place below. */
  _pick(u, v) {
    const ray = new THREE.Raycaster(), [x, y] = [2 * u / this._width - 1, 1 - 2 * v / this._height];
    ray.setFromCamera(new THREE.Vector2(x, y), this._camera);
    const [hit] = ray.intersectObjects(this._solid.meshes, false);
    const one = hit ? hit.object.things[hit.instanceId] : this._nearest(u, v);
    const floor = new THREE.Plane(new THREE.Vector3(0, 0, 1), -this._solid.ground);
    const spot = hit?.point ?? ray.ray.intersectPlane(floor, new THREE.Vector3());
    if (!spot) return; // the sky
    const point = [spot.x + this._solid.origin[0], spot.y + this._solid.origin[1]];
    const below = [...this._view.data.places.values()].filter((place) => inside(...point, place.rings)).pop();
    this._view.onPick((one ?? below)?.iri ?? null, point);
  }

  _nearest(u, v) {
    let best = null, least = NEAR;
    for (const [one, x, y] of this._onScreen()) {
      const distance = Math.hypot(x - u, y - v);
      if (distance < least) { least = distance; best = one; }
    }
    return best;
  }

  /** [object, u, v, distance] of the objects in front of the camera; u, v [px] are the top of the box. */
  _onScreen() {
    const found = [];
    for (const one of this._solid.meshes.flatMap((mesh) => mesh.things)) {
      const [x, y, z, , , dz] = boxOf(one, this._view.layers.boxes), point = this._project(x, y, z + dz / 2);
      if (point) found.push([one, ...point]);
    }
    return found;
  }

  /** [u, v, distance] of a point [m], in pixels and metres; null off the canvas. */
  _project(x, y, z, edge = 1) {
    const point = this._solid.at(x, y, z), distance = point.distanceTo(this._camera.position);
    point.project(this._camera);
    if (!(Math.abs(point.x) < edge && Math.abs(point.y) < edge && point.z < 1)) return null;
    return [(point.x + 1) / 2 * this._width, (1 - point.y) / 2 * this._height, distance];
  }

  _resize() {
    const { clientWidth, clientHeight } = this._canvas;
    if (!clientWidth || !clientHeight) return;
    [this._width, this._height] = [clientWidth, clientHeight];
    this._renderer.setPixelRatio(devicePixelRatio || 1);
    this._renderer.setSize(clientWidth, clientHeight, false);
    [this._names.width, this._names.height] = [this._canvas.width, this._canvas.height];
    this._camera.aspect = clientWidth / clientHeight;
    this._camera.updateProjectionMatrix();
    this._render();
  }

  /** Draw; with many objects, names follow when the map has stopped moving. */
  _renderMoving() {
    clearTimeout(this._rest);
    this._isMoving = this._view.data.objects.size > MANY;
    this._rest = setTimeout(() => { this._isMoving = false; this._render(); }, REST);
    this._render();
  }

  /** Draw with the next frame of the screen. */
  _render() {
    this._waiting ||= requestAnimationFrame(() => { this._waiting = 0; this._renderNow(); });
  }

  _renderNow() {
    if (!this._canvas.isConnected) return;
    this._view.readColours();
    if (this._changed) this._solid.update();
    this._changed = false;
    this._solid.scene.background = new THREE.Color(this._view.panel);
    this._renderer.render(this._solid.scene, this._camera);
    this._writeNames();
  }

  /** What is shown, with the names, as a PNG. */
  toBlob() {
    this._renderNow();
    const picture = document.createElement("canvas"), c = picture.getContext("2d");
    [picture.width, picture.height] = [this._canvas.width, this._canvas.height];
    c.drawImage(this._canvas, 0, 0);
    c.drawImage(this._names, 0, 0);
    return new Promise((done) => { picture.toBlob(done, "image/png"); });
  }

  /** Names of stops, places, the selected object and the objects nearest to the camera. */
  _writeNames() {
    const view = this._view, { ground } = this._solid, write = this._writer();
    view.plan?.steps.forEach((step, n) => write(String(n + 1), this._project(step.x, step.y, ground), view.accent, "700 14px"));
    for (const place of view.data.places.values()) {
      const middle = this._project((place.xmin + place.xmax) / 2, (place.ymin + place.ymax) / 2, ground);
      write(view.nameOfPlace(place), middle, view.colourOfPlace(place), "600 13px");
    }
    if (this._isMoving) return;
    const order = (found) => (found[0].iri === view.selected ? -1 : found[3]);
    const nearest = this._onScreen().sort((a, b) => order(a) - order(b)).slice(0, NAMES);
    for (const [one, ...top] of nearest) {
      const selected = one.iri === view.selected;
      if (selected || view.layers.labels) write(view.data.nameOf(one).slice(0, 40), top, view.ink, selected ? "700 13px" : "12px");
    }
  }

  /** A function that writes a text above a point [u, v] of an empty canvas, if there is room. */
  _writer() {
    const ratio = devicePixelRatio || 1, c = this._names.getContext("2d"), taken = new Taken(this._width, this._height);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, this._width, this._height);
    c.textAlign = "center";
    taken.take(this._width - 50, 0, 50, 190, true); // the buttons
    return (text, point, colour, font) => {
      c.font = `${font} system-ui, sans-serif`;
      const width = c.measureText(text).width;
      if (!point || !taken.take(point[0] - width / 2 - 2, point[1] - 18, width + 4, 15)) return;
      drawText(c, this._view, text, point[0], point[1] - 7, colour);
    };
  }
}
