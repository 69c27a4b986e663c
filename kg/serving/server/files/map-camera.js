// The camera of the map: flat, from above, or in three dimensions; moved by pointers, wheel and keys.
import * as THREE from "/files/vendor/three.min.js";

const FIELD = 45 * Math.PI / 180; // [rad] of view, from top to bottom, in three dimensions
const DEPTH = 500; // [m] above and below the target that the flat camera sees
const MIN_SCALE = 0.5, MAX_SCALE = 800; // [px/m]
const MIN_DISTANCE = 0.3, MAX_DISTANCE = 5000; // [m] from the camera to its target
export const NEAREST = 0.05; // [m] from the camera in three dimensions to what it sees
const SOUTH = { azimuth: 0, polar: 0.67 }; // [rad] first direction of the camera in three dimensions
const STILL = 6; // [px] that a pointer may move during a click
const MARGIN = 30; // [px] above and below all of the map
const ASIDE = 56; // [px] beside it, where the buttons are; less on a phone
const FLIGHT = 700; // [ms]
const KEYS = { "+": 1.25, "=": 1.25, "-": 0.8 };
const CALM = matchMedia("(prefers-reduced-motion: reduce)");

export class MapCamera {
  /** `moved()` is called after movements, `clicked(u, v)` for clicks and the space bar, `fit()` for the key 0. */
  constructor(canvas, { moved, clicked, fit }) {
    this.isFlat = true;
    this.width = this.height = 1; // [px]
    this.isHeld = false; // whether somebody drags it
    this.origin = [0, 0]; // [m] of the scene, since graphics hardware has 24 bits for a number
    this._moved = moved;
    const flat = new THREE.OrthographicCamera(), solid = new THREE.PerspectiveCamera(45, 1, NEAREST, 2 * MAX_DISTANCE);
    solid.up.set(0, 0, 1);
    flat.zoom = 40;
    flat.far = 2 * DEPTH;
    flat.position.z = DEPTH;
    this._flat = new THREE.OrbitControls(flat, canvas);
    this._solid = new THREE.OrbitControls(solid, canvas);
    const { PAN, ROTATE, DOLLY } = THREE.MOUSE, keys = { keyPanSpeed: 60, zoomToCursor: true };
    Object.assign(this._flat, keys, { enableRotate: false, minZoom: MIN_SCALE, maxZoom: MAX_SCALE, zoomSpeed: 4,
      mouseButtons: { LEFT: PAN, MIDDLE: DOLLY, RIGHT: PAN }, touches: { ONE: THREE.TOUCH.PAN, TWO: THREE.TOUCH.DOLLY_PAN } });
    Object.assign(this._solid, keys, { enabled: false, screenSpacePanning: false, maxPolarAngle: 1.53, zoomSpeed: 2,
      minDistance: MIN_DISTANCE, maxDistance: MAX_DISTANCE, mouseButtons: { LEFT: ROTATE, MIDDLE: DOLLY, RIGHT: PAN } });
    for (const controls of [this._flat, this._solid]) {
      controls.listenToKeyEvents(canvas);
      controls.addEventListener("change", () => this._change());
      controls.addEventListener("start", () => { this.isHeld = true; });
      controls.addEventListener("end", () => { this.isHeld = false; });
    }
    this._listen(canvas, clicked, fit);
  }

  /** The camera of three.js. */
  get camera() {
    return this._controls.object;
  }

  get _controls() {
    return this.isFlat ? this._flat : this._solid;
  }

  /** [m] from the camera to where it looks. */
  get distance() {
    return this._controls.object.position.distanceTo(this._controls.target);
  }

  /** Where it looks: x, y, z [m] of the target, pixels a metre there, and the direction [rad] to the camera. */
  get state() {
    const { target, object } = this._controls, [x, y] = this.origin;
    const scale = this.isFlat ? object.zoom : this._scaleAt(this.distance);
    const turned = this.isFlat ? SOUTH : { azimuth: this._solid.getAzimuthalAngle(), polar: this._solid.getPolarAngle() };
    return { x: target.x + x, y: target.y + y, z: target.z, scale, ...turned };
  }

  /** Look there; what is left out stays as it is. */
  look(given) {
    const state = { ...this.state, ...given }, { target, object } = this._controls;
    target.set(state.x - this.origin[0], state.y - this.origin[1], state.z);
    if (this.isFlat) {
      object.position.copy(target).setZ(target.z + DEPTH);
      object.zoom = Math.min(Math.max(state.scale, MIN_SCALE), MAX_SCALE);
    } else {
      const far = this.height / (2 * Math.tan(FIELD / 2) * state.scale), { azimuth, polar } = state;
      const [out, up] = [Math.sin(polar), Math.cos(polar)];
      object.position.set(out * Math.sin(azimuth), -out * Math.cos(azimuth), up).multiplyScalar(far).add(target);
    }
    this._apply();
  }

  /** Move there within a moment; at once for who wants no motion. */
  fly(given) {
    cancelAnimationFrame(this._flight);
    const from = this.state, to = { ...from, ...given }, start = performance.now();
    const step = (now) => {
      const part = CALM.matches ? 1 : Math.min((now - start) / FLIGHT, 1), eased = part * part * (3 - 2 * part);
      const between = Object.fromEntries(Object.keys(from).map((key) => [key, from[key] + eased * (to[key] - from[key])]));
      this.look({ ...between, scale: from.scale * (to.scale / from.scale) ** eased });
      if (part < 1) this._flight = requestAnimationFrame(step);
    };
    step(start);
  }

  /** Change between the flat view and three dimensions; the same point stays in the middle. */
  turn() {
    const state = { ...this.state, ...SOUTH };
    this._controls.enabled = false;
    this.isFlat = !this.isFlat;
    this._controls.enabled = true;
    this.look(state);
  }

  /** [px] that stay free beside the map. */
  get _aside() {
    return Math.min(ASIDE, 0.08 * this.width);
  }

  /** @type {(bounds: number[][], point: number[], scale: number) => any}
   * The point nearest to one by which a flat map shows no more outside of two corners than it must. */
  within([low, high], point, scale) {
    return point.map((value, k) => {
      const half = (k ? this.height : this.width) / 2 / scale, margin = (k ? MARGIN : this._aside) / scale;
      const [least, most] = [low[k] - margin + half, high[k] + margin - half];
      return least > most ? (least + most) / 2 : Math.min(Math.max(value, least), most);
    });
  }

  /** Show a map between two corners [m], to `high` [m] above the floor; in three dimensions its points, if any. */
  fit(bounds, ground, high, points = []) {
    const [[xmin, ymin], [xmax, ymax]] = bounds;
    const wide = (this.width - 2 * this._aside) / (xmax - xmin + 0.4), tall = (this.height - 2 * MARGIN) / (ymax - ymin + 0.4);
    const middle = { x: (xmin + xmax) / 2, y: (ymin + ymax) / 2, z: ground + (this.isFlat ? 0 : high / 2) };
    this.look({ ...middle, ...SOUTH, scale: Math.min(wide, tall, 250) });
    if (this.isFlat) return;
    const outer = points.length ? points : [[xmin, ymin], [xmin, ymax], [xmax, ymin], [xmax, ymax]];
    const corners = outer.flatMap(([x, y]) => [[x, y, ground], [x, y, ground + high]]);
    const fits = (scale) => {
      this.look({ scale });
      this._centre(corners);
      return corners.map((corner) => this.project(...corner)).every((spot) => spot && spot[0] > this._aside && spot[1] > MARGIN && spot[0] < this.width - this._aside && spot[1] < this.height - MARGIN);
    };
    let { scale } = this.state;
    scale *= 2;
    while (scale > MIN_SCALE && !fits(scale)) scale *= 0.95;
  }

  /** Bring what is between points [m] into the middle of the canvas, in three dimensions from the south. */
  _centre(points) {
    const spots = points.map((point) => this.project(...point)), { x, y, scale, polar } = this.state;
    if (spots.some((spot) => !spot)) return;
    const [u, v] = [0, 1].map((k) => (Math.min(...spots.map((spot) => spot[k])) + Math.max(...spots.map((spot) => spot[k]))) / 2);
    this.look({ x: x + (u - this.width / 2) / scale, y: y - (v - this.height / 2) / scale / Math.cos(polar) });
  }

  zoom(factor) {
    this.look({ scale: this.state.scale * factor });
  }

  resize(width, height) {
    const { scale } = this.state, [flat, solid] = [this._flat.object, this._solid.object];
    [this.width, this.height] = [width, height];
    Object.assign(flat, { left: -width / 2, right: width / 2, top: height / 2, bottom: -height / 2 });
    solid.aspect = width / height;
    flat.updateProjectionMatrix();
    solid.updateProjectionMatrix();
    this.look({ scale });
  }

  /** [u, v, scale] of a point [m]: pixels of the canvas, and pixels a metre there; null behind the camera. */
  project(x, y, z) {
    const { camera } = this, point = new THREE.Vector3(x - this.origin[0], y - this.origin[1], z);
    if (this.isFlat) {
      const { target } = this._flat, { zoom } = camera;
      return [this.width / 2 + (point.x - target.x) * zoom, this.height / 2 - (point.y - target.y) * zoom, zoom];
    }
    const depth = -point.applyMatrix4(camera.matrixWorldInverse).z;
    if (!(depth > camera.near)) return null;
    point.applyMatrix4(camera.projectionMatrix);
    return [(point.x + 1) / 2 * this.width, (1 - point.y) / 2 * this.height, this._scaleAt(depth)];
  }

  /** The ray of three.js through a point of the canvas [px]. */
  rayAt(u, v) {
    const caster = new THREE.Raycaster();
    caster.setFromCamera(new THREE.Vector2(2 * u / this.width - 1, 1 - 2 * v / this.height), this.camera);
    return caster;
  }

  /** Pixels a metre at a distance [m] in three dimensions. */
  _scaleAt(distance) {
    return this.height / (2 * Math.tan(FIELD / 2) * distance);
  }

  _apply() {
    this._isSet = true;
    this.camera.updateProjectionMatrix();
    this._controls.update();
    this.camera.updateMatrixWorld();
    this._isSet = false;
    this._moved();
  }

  /** A movement by the controls; those of `look` are told once, at their end. */
  _change() {
    if (this._isSet) return;
    this.camera.updateMatrixWorld();
    this._moved();
  }

  _listen(canvas, clicked, fit) {
    let down = null;
    canvas.addEventListener("pointerdown", (event) => {
      cancelAnimationFrame(this._flight);
      down = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null;
    });
    canvas.addEventListener("pointerup", (event) => {
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > STILL) return;
      const box = canvas.getBoundingClientRect();
      clicked(event.clientX - box.left, event.clientY - box.top);
    });
    canvas.addEventListener("keydown", (event) => {
      if (KEYS[event.key]) this.zoom(KEYS[event.key]);
      else if (event.key === "0") fit();
      else if (event.key === " ") clicked(this.width / 2, this.height / 2);
      else return;
      event.preventDefault();
    });
  }
}
