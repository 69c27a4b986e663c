// The scene of the map: surface, floor, walls, places, and the objects as boxes and dots. Metres, z up.
import { NEAREST } from "/files/map-camera.js";
import { drawing } from "/files/page-elements.js";
import { facingOf, floorSheets, SurfaceReader, surfaceSheet } from "/files/surface.js";
import * as THREE from "/files/vendor/three.min.js";

const TALL = 3; // cells of walls
const SMALL = 0.12; // [m] side of a box of unknown extent
const MIN_SIDE = 0.03; // [m] of a box
const BELOW = 0.06; // [m] from the floor of a surface down to the picture of the cells
const LIFTED = 0.02; // [m] of the picture of a surface above the floor and places
const GROUND = -2; // drawing order of the floor; places come next, then the things on the floor
const FADED = 0.12; // of what is not in focus
const STRIDE = 2654435761; // a prime: steps of it meet all of so many numbers, and few of them spread wide
const AROUND = 0.08; // [m] around a box in focus that keeps its colour
const WIDER = 2.6; // sides of the square of a voxel in three dimensions: three.js leaves out the field of view of 45 degrees
const LOW = 0.25; // [m] above the floor of what never fades
const AHEAD = 0.3; // [m] before the selected thing, from which on what hides it fades
const NEAR = 0.5; // of the way to where the camera looks: what is nearer fades
const WINDOW = 0.16; // radius of the window to the selected thing, as the tangent of an angle
const TURN = 510 / 254 * Math.PI; // [rad] of where a voxel faces, for each unit of the fourth part of its colour
const TOWARDS = 0.25; // cosine of the angle between the outside of a wall and the camera, from which on the wall fades
/** The part of a shader that leaves out what hides the selected thing, what is close, and outer walls before the room. */
const FADE = `float turn = color.a * ${TURN};
  bool outer = color.a < 0.998 && dot(vec2(cos(turn), sin(turn)), normalize(cameraPosition - position).xy) > ${TOWARDS};
  float ahead = -mvPosition.z, dither = fract(sin(dot(position, vec3(12.9898, 78.233, 37.719))) * 43758.5453);
  bool hides = spot.z < 0.0 && ahead < -spot.z - reach && distance(mvPosition.xy / ahead, spot.xy / -spot.z) < ${WINDOW} * (0.8 + 0.4 * dither);
  bool faded = position.z > low && (hides || outer || ahead < near * (0.8 + 0.2 * dither));`;
/** The part of a shader that draws how near the camera a point is, in place of its colour. */
const DISTANCE = `if (asked) {
    vec3 parts = fract(gl_FragCoord.w * ${NEAREST} * vec3(1.0, 255.0, 65025.0));
    gl_FragColor.rgb = parts - vec3(parts.yz / 255.0, 0.0);
  }`;
const CUBE = new THREE.BoxGeometry(1, 1, 1), SQUARE = new THREE.PlaneGeometry(1, 1);
const [CUBE_EDGES, SQUARE_EDGES] = [CUBE, SQUARE].map((shape) => new THREE.EdgesGeometry(shape).getAttribute("position"));
const FACES = { flat: 0.1, seen: 0.15, solid: 0.35 }; // opacity of the faces of boxes: from above, where a surface is seen, without
export const MANY = 3000; // with more objects, boxes have no edges, and dots are small
export const BOXES = 18; // [px/m] at and above this scale a flat map has boxes

THREE.ColorManagement.enabled = false; // colours of pages and of voxels are drawn as they are

export class MapScene {
  /** The scene of `view` (a MapView). */
  constructor(view) {
    this._view = view;
    this.scene = new THREE.Scene();
    this.surface = new SurfaceReader(view);
    this.boxes = []; // meshes; `things` of a mesh are the objects, each with so many `faces`
    this._points = this._dots = this._sized = null; // of the surface; of the objects: dots, boxes
    this._fade = { spot: { value: new THREE.Vector3() }, reach: { value: 0 }, near: { value: 0 }, low: { value: 0 }, asked: { value: false } }; // of the shader
    this._cutter = new THREE.Plane(new THREE.Vector3(0, 0, -1), 2);
    this._parts = new Map(); // name -> group
    this._sources = new Map(); // name -> data that the group was made from
    const sun = new THREE.DirectionalLight(0xffffff, 0.9);
    sun.position.set(-2, -3, 6);
    this.scene.add(sun, new THREE.AmbientLight(0xffffff, 2.3));
  }

  /** Update the groups whose data changed. */
  update() {
    const view = this._view, { data, layers, dark, selected, isFocused, camera, cut } = view, { floor, places } = data;
    const surface = this.surface.current(), { isFlat, origin } = camera, focus = isFocused && selected;
    this._part("surface", [surface, origin, focus, dark, isFlat, isFlat && cut], (group) => this._addSurface(group, surface));
    this._part("floor", [floor, layers.floor, layers.viewed, dark, surface, origin, isFlat, !surface && cut], (group) => this._addFloor(group, surface));
    this._part("places", [places, floor, dark, selected, origin, isFlat], (group) => this._addPlaces(group));
    this._part("objects", [view.drawn, origin, focus, selected, layers.boxes, dark, isFlat, !this._points], () => { this._sized = this._dots = null; });
    this.scene.background = new THREE.Color(view.panel);
  }

  /** Adapt to the camera, before each drawing. */
  adapt() {
    const { camera, data, cut, drawn, clusters } = this._view, { scale } = camera.state;
    this._cutter.constant = data.ground() + cut;
    if (this._points) {
      const part = this._view.isMoving ? this._view.share : 1;
      this._points.geometry.setDrawRange(0, Math.ceil(part * this._points.count));
      this._points.material.size = WIDER * this._points.step / Math.sqrt(part);
      this._fadeNear();
    }
    const isQuick = this._view.isMoving && drawn.length > MANY; // dots stand for many boxes until the map rests
    const isSized = !isQuick && (!camera.isFlat || scale >= BOXES), isDotted = !clusters && (isQuick || camera.isFlat);
    if (isSized) this._sized ??= this._added(this._boxesOf(drawn)); // made once they are seen
    if (isDotted) this._dots ??= this._added(this._dotsOf(drawn));
    if (this._sized) this._sized.visible = isSized;
    if (!this._dots) return;
    this._dots.visible = isDotted;
    this._dots.material.size = drawn.length > MANY ? 5 : 2 * radiusAt(scale);
  }

  /** One more part of the objects. */
  _added(part) {
    this._parts.get("objects").add(part);
    return part;
  }

  /** Open the view to the selected thing, and past what is close. */
  _fadeNear() {
    const { camera, data, selected } = this._view, { spot, reach, near, low } = this._fade, one = data.thingAt(selected);
    spot.value.set(0, 0, 0);
    if (one) spot.value.copy(this.at(one.x, one.y, one.z)).applyMatrix4(camera.camera.matrixWorldInverse);
    reach.value = AHEAD + Math.max(one?.dx ?? 0, one?.dy ?? 0) / 2;
    near.value = NEAR * camera.distance;
    low.value = data.ground() + LOW;
  }

  /** The point of the surface that is drawn at a pixel, on its ray; null without one. */
  _seenAt(u, v, { origin, direction }) {
    const { renderer, camera: { camera, height } } = this._view, { asked } = this._fade, [x, y] = [u, height - v].map(Math.floor), found = new Uint8Array(4);
    if (!this._points || !renderer) return null;
    const gl = renderer.getContext();
    asked.value = true;
    renderer.render(this._points, camera);
    gl.readPixels(...[x, y].map((one) => one * renderer.getPixelRatio()), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, found);
    asked.value = false;
    const near = (found[0] + found[1] / 255 + found[2] / 65025) / 255, axis = camera.getWorldDirection(new THREE.Vector3());
    this._view.draw();
    return near ? direction.clone().multiplyScalar(NEAREST / near / direction.dot(axis)).add(origin) : null;
  }

  /** Forget what graphics memory held. */
  forget() {
    for (const name of this._sources.keys()) this._sources.set(name, null);
  }

  /** Position of a point of the map in the scene; without a height, on the floor. */
  at(x, y, z = this._view.data.ground()) {
    const [left, low] = this._view.camera.origin;
    return new THREE.Vector3(x - left, y - low, z);
  }

  /** What is met first at a pixel: {thing?, point [m]}; the floor below everything, null in the sky. */
  meet(u, v) {
    const ray = this._view.camera.rayAt(u, v), ground = this._view.data.ground(), [left, low] = this._view.camera.origin;
    const [hit] = ray.intersectObjects(this._sized?.visible ? this.boxes : [], false);
    const floor = ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), -ground), new THREE.Vector3());
    const spot = this._seenAt(u, v, ray.ray) ?? hit?.point ?? floor;
    return spot && { thing: hit?.object.things[Math.floor(hit.faceIndex / hit.object.faces)], point: [spot.x + left, spot.y + low, spot.z] };
  }

  _part(name, sources, fill) {
    const before = this._sources.get(name), old = this._parts.get(name);
    if (before && sources.every((source, n) => source === before[n])) return;
    if (old) discard(this.scene, old);
    const group = new THREE.Group();
    fill(group);
    this.scene.add(group);
    this._parts.set(name, group);
    this._sources.set(name, sources);
  }

  /** The surface: from above as one picture, which machines that draw in software need, or voxel by voxel. */
  _addSurface(group, surface) {
    this._points = null;
    if (!surface) return;
    const { camera, data, cut } = this._view, colours = this._coloursOf(surface);
    if (camera.isFlat) {
      const sheet = surfaceSheet(surface, colours, data.ground() + cut);
      group.add(this._picture(sheet, data.ground() + LIFTED));
    } else group.add(this._points = this._voxels(surface, colours, surface.facing ??= facingOf(surface, data.ground())));
  }

  /** Voxels as squares, any first part of which shows all the room; the fourth part of a colour is where it faces. */
  _voxels({ points, size }, colours, facing) {
    const count = points.length / 3, places = new Float32Array(points.length), tones = new Uint32Array(count), [left, low] = this._view.camera.origin;
    const given = new Uint32Array(colours.buffer), stride = STRIDE % count || 1;
    for (let n = 0, from = 0; n < count; n++, from = (from + stride) % count) {
      places[3 * n] = points[3 * from] - left;
      places[3 * n + 1] = points[3 * from + 1] - low;
      places[3 * n + 2] = points[3 * from + 2];
      tones[n] = (given[from] & 0xffffff) | (facing[from] << 24);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(tones.buffer), 4, true));
    const material = new THREE.PointsMaterial({ vertexColors: true, clippingPlanes: [this._cutter] }), voxels = new THREE.Points(geometry, material);
    material.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, this._fade);
      shader.vertexShader = `uniform vec3 spot; uniform float reach, near, low;\n${shader.vertexShader}`
        .replace(/}\s*$/, `${FADE}\n  if (faded) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);\n}`);
      shader.fragmentShader = `uniform bool asked;\n${shader.fragmentShader}`.replace(/}\s*$/, `${DISTANCE}\n}`);
    };
    return Object.assign(voxels, { step: size, count });
  }

  /** A picture {canvas, x, y, wide, high} [m] that lies at a height [m]. */
  _picture({ canvas, x, y, wide, high }, z) {
    const texture = new THREE.CanvasTexture(canvas);
    texture.magFilter = texture.minFilter = THREE.NearestFilter;
    texture.generateMipmaps = false;
    const material = new THREE.MeshBasicMaterial({ map: texture, alphaTest: 0.5, side: THREE.DoubleSide });
    const mesh = new THREE.Mesh(new THREE.PlaneGeometry(wide, high), material);
    mesh.position.copy(this.at(x + wide / 2, y + high / 2, z));
    return mesh;
  }

  /** The colours of a surface; paler around the box in focus. */
  _coloursOf({ points, colours }) {
    const one = this._view.inFocus;
    if (!one) return colours;
    const pale = new THREE.Color(this._view.panel), made = colours.slice(), isAt = withinBox(one);
    for (let n = 0, k = 0; n < points.length; n += 3, k += 4) {
      if (isAt(points[n], points[n + 1], points[n + 2])) continue;
      made[k] = mixed(colours[k], pale.r);
      made[k + 1] = mixed(colours[k + 1], pale.g);
      made[k + 2] = mixed(colours[k + 2], pale.b);
    }
    return made;
  }

  /** The cells of the floor, and its walls where no surface shows them. */
  _addFloor(group, surface) {
    const { data, layers, dark, camera, cut } = this._view, down = surface ? BELOW : 0;
    const sheets = layers.floor || layers.viewed ? floorSheets(data.floor, { viewed: layers.viewed, dark }) : [];
    for (const sheet of sheets) {
      const mesh = this._picture(sheet, (sheet.z ?? 0) - down);
      mesh.renderOrder = GROUND;
      group.add(mesh);
    }
    const walls = layers.floor && !surface && !camera.isFlat ? data.floor.flatMap((tile) => wallsOf(tile, cut)) : [];
    if (walls.length) group.add(this._boxes(CUBE, walls, { color: dark ? "#7d8a96" : "#8a949e" }));
  }

  /** Boxes {x, y, z, sides, colour?, alpha?, yaw?} of one shape as one mesh; x, y, z [m] are the centre.
   *
   * They are no instances, of which a machine that draws in software draws each on its own. */
  _boxes(shape, boxes, given) {
    const [corners, normals] = ["position", "normal"].map((name) => shape.getAttribute(name)), faces = shape.index.array, each = corners.count;
    const places = new Float32Array(3 * boxes.length * each), turned = places.slice(), colours = new Float32Array(4 * boxes.length * each);
    const index = new Uint32Array(boxes.length * faces.length), tone = new THREE.Color(), point = new THREE.Vector3();
    boxes.forEach((box, n) => {
      const matrix = this._placed(box);
      tone.set(box.colour ?? "#ffffff");
      for (let k = 0; k < each; k++) {
        const at = n * each + k;
        point.fromBufferAttribute(corners, k).applyMatrix4(matrix).toArray(places, 3 * at);
        point.fromBufferAttribute(normals, k).transformDirection(matrix).toArray(turned, 3 * at);
        colours.set([tone.r, tone.g, tone.b, box.alpha ?? 1], 4 * at);
      }
      for (let k = 0; k < faces.length; k++) index[n * faces.length + k] = n * each + faces[k];
    });
    const geometry = new THREE.BufferGeometry(), mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ ...given, vertexColors: true }));
    geometry.setIndex(new THREE.BufferAttribute(index, 1));
    geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(turned, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colours, 4));
    return Object.assign(mesh, { things: boxes.map(({ one }) => one), faces: faces.length / 3 });
  }

  _placed({ x, y, z, sides, yaw = 0 }) {
    return new THREE.Matrix4().makeRotationZ(yaw).scale(new THREE.Vector3(...sides)).setPosition(this.at(x, y, z));
  }

  _addPlaces(group) {
    const ground = this._view.data.ground();
    for (const place of this._view.data.places.values()) {
      const color = hexOf(this._view.colourOfPlace(place)), isChosen = place.iri === this._view.selected;
      const rings = place.rings.map((ring) => ring.map(([x, y]) => this.at(x, y, ground + 0.01)));
      const shape = new THREE.Shape(rings[0]);
      shape.holes = rings.slice(1).map((ring) => new THREE.Path(ring));
      const tint = { color, transparent: true, opacity: isChosen ? 0.28 : 0.14, depthWrite: false, side: THREE.DoubleSide };
      const floor = new THREE.Mesh(new THREE.ShapeGeometry(shape), new THREE.MeshBasicMaterial(tint));
      floor.position.z = ground;
      floor.renderOrder = GROUND + 1;
      const line = new THREE.LineBasicMaterial({ color, depthTest: !this._view.camera.isFlat });
      group.add(floor, ...rings.map((ring) => new THREE.LineLoop(new THREE.BufferGeometry().setFromPoints(ring), line)));
    }
  }

  /** The boxes of the shown objects, for both views. */
  _boxesOf(drawn) {
    const { camera: { isFlat } } = this._view, [shape, edges] = isFlat ? [SQUARE, SQUARE_EDGES] : [CUBE, CUBE_EDGES];
    const opacity = FACES[isFlat ? "flat" : this._points ? "seen" : "solid"], boxes = [], sides = [], colours = [];
    for (const one of drawn) {
      const box = this._boxOf(one);
      if (!box) continue;
      boxes.push(box);
      if (drawn.length <= MANY || one.iri === this._view.selected) this._addEdges(box, edges, sides, colours);
    }
    this.boxes = [this._boxes(shape, boxes, { transparent: true, opacity, depthWrite: false, depthTest: !isFlat })];
    return new THREE.Group().add(...this.boxes, linesOf(sides, colours, !isFlat));
  }

  /** The box of an object; without a measured size, nothing in the flat map and a small cube in three dimensions. */
  _boxOf(one) {
    const { camera: { isFlat }, layers, selected } = this._view, isSized = layers.boxes && one.dx, grown = one.iri === selected && !isFlat ? 1.06 : 1;
    if (isFlat && !isSized) return null;
    const sides = isSized ? [one.dx, one.dy, one.dz].map((side) => grown * Math.max(side, MIN_SIDE)) : [SMALL, SMALL, SMALL];
    return { one, x: one.x, y: one.y, z: one.z ?? 0, sides, yaw: one.yaw, colour: this._view.hexOfClass(one.class), alpha: this._view.strengthOf(one) };
  }

  _addEdges(box, edges, sides, colours) {
    const isChosen = box.one.iri === this._view.selected, colour = new THREE.Color(isChosen ? hexOf(this._view.ink) : box.colour);
    const matrix = this._placed(box), corner = new THREE.Vector3();
    for (let n = 0; n < edges.count; n++) {
      corner.fromBufferAttribute(edges, n).applyMatrix4(matrix);
      sides.push(corner.x, corner.y, corner.z);
      colours.push(colour.r, colour.g, colour.b, isChosen ? 1 : 0.5 + 0.5 * box.alpha);
    }
  }

  /** A disc for each object, of a size in pixels. */
  _dotsOf(drawn) {
    const geometry = new THREE.BufferGeometry(), colours = [];
    for (const one of drawn) {
      const { r, g, b } = new THREE.Color(this._view.hexOfClass(one.class));
      colours.push(r, g, b, this._view.strengthOf(one));
    }
    geometry.setFromPoints(drawn.map((one) => this.at(one.x, one.y, one.z ?? 0)));
    geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 4));
    const material = new THREE.PointsMaterial({ vertexColors: true, transparent: true, depthTest: false, sizeAttenuation: false, alphaTest: 0.02 });
    if (drawn.length <= MANY) material.map = DISC;
    const dots = new THREE.Points(geometry, material);
    dots.renderOrder = 1;
    return dots;
  }
}

/** [px] of a dot. */
export const radiusAt = (scale) => Math.min(Math.max(scale / 14, 3.5), 7);

function linesOf(sides, colours, depthTest) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(sides, 3));
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 4));
  return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthTest }));
}

/** A function that returns whether a point [m] lies in an object's box, or a little beside it. */
function withinBox({ x, y, z = 0, dx = SMALL, dy = SMALL, dz = SMALL, yaw = 0 }) {
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)], [a, b, h] = [dx, dy, dz].map((side) => side / 2 + AROUND);
  return (px, py, pz) => Math.abs(pz - z) < h && Math.abs((px - x) * c + (py - y) * s) < a && Math.abs((py - y) * c - (px - x) * s) < b;
}

const mixed = (value, pale) => Math.round(FADED * 2 * value + (1 - FADED * 2) * 255 * pale);

const painter = drawing(1, 1); // that reads colours

/** A CSS colour in the form of three.js. */
export function hexOf(colour) {
  painter.fillStyle = colour;
  return painter.fillStyle;
}

/** Boxes of this height [m] over the wall cells of a tile; adjacent cells of a row are one box. */
function wallsOf(tile, high) {
  const { side, size, cells } = tile, found = [];
  for (let x = 0; x < side; x++) {
    for (let y = 0, from = -1; y <= side; y++) {
      const wall = y < side && cells[x * side + y] === TALL;
      if (wall && from < 0) from = y;
      if (wall || from < 0) continue;
      found.push({ x: tile.x + (x + 0.5) * size, y: tile.y + (from + y) / 2 * size, z: (tile.z ?? 0) + high / 2, sides: [size, (y - from) * size, high] });
      from = -1;
    }
  }
  return found;
}

/** Remove a group from the scene and from graphics memory. */
function discard(scene, group) {
  scene.remove(group);
  group.traverse((one) => {
    if (one.geometry && one.geometry !== CUBE && one.geometry !== SQUARE) one.geometry.dispose();
    if (one.material?.map !== DISC) one.material?.map?.dispose();
    one.material?.dispose();
  });
}

/** A white disc, for dots. */
function disc() {
  const c = drawing(32, 32);
  c.fillStyle = "#fff";
  c.arc(16, 16, 15, 0, 7);
  c.fill();
  return new THREE.CanvasTexture(c.canvas);
}

const DISC = disc();
