// The scene in three dimensions: floor, walls, places, boxes of objects, robot, trail, plan. Metres, z up.
import { pointsBelow } from "/files/surface-layer.js";
import * as THREE from "/files/vendor/three.min.js";

const WALL = 0.5; // [m] height of walls in the picture, low enough to look over them
const TALL = 3; // cells of walls
const SMALL = 0.12; // [m] side of a box of unknown extent
const MIN_SIDE = 0.03; // [m] of a box
const GROUND = -2; // drawing order of the floor; places come next, then the things on the floor
const FACE = 0.5; // opacity of the faces of boxes, whose edges are solid
const MANY = 3000; // with more objects, boxes have no edges
const SHADES = 5; // steps of existence, one mesh each
const UNIT = new THREE.BoxGeometry(1, 1, 1);
const EDGES = new THREE.EdgesGeometry(UNIT).getAttribute("position");

export class SolidScene {
  /** The scene of `view` (a MapView). Positions are relative to `origin` [m], since graphics hardware has 24 bits for each. */
  constructor(view, origin) {
    this._view = view;
    this.origin = origin;
    this.scene = new THREE.Scene();
    this.meshes = []; // of objects; `things` of a mesh are the objects of its instances
    this._parts = new Map(); // name -> group
    this._sources = new Map(); // name -> data that the group was made from
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(-2, -3, 6);
    this.scene.add(sun, new THREE.AmbientLight(0xffffff, 1.8));
  }

  /** Update the groups whose data changed. */
  update() {
    const { data, layers, dark, selected, plan } = this._view, { floor, places, doors, robot, trail } = data;
    const surface = this._view.surfaceLayer.current();
    this._part("surface", [surface], (group) => this._addSurface(group, surface));
    this._part("floor", [floor, layers.floor, layers.viewed, dark, surface], (group) => this._addFloor(group, !surface));
    this._part("places", [places, doors, floor, dark, selected], (group) => this._addPlaces(group));
    this._part("objects", [{}], (group) => this._addObjects(group));
    this._part("robot", [{}, robot], (group) => this._addRobot(group, trail));
    this._part("plan", [plan, floor, dark], (group) => this._addPlan(group));
  }

  /** Height of the floor [m] in most of the map. */
  get ground() {
    return this._view.data.ground();
  }

  /** Position of a point of the map in the scene; without a height, on the floor. */
  at(x, y, z = this.ground) {
    return new THREE.Vector3(x - this.origin[0], y - this.origin[1], z);
  }

  /** A point a little above the floor. */
  over(x, y, height) {
    return this.at(x, y, this.ground + height);
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

  /** The voxels of the surface, as squares that face the camera. */
  _addSurface(group, surface) {
    if (!surface) return;
    const { places, tones } = pointsBelow(surface, this.origin, this.ground), geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
    geometry.setAttribute("color", new THREE.Float32BufferAttribute(tones, 3));
    group.add(new THREE.Points(geometry, new THREE.PointsMaterial({ size: 2 * surface.size, vertexColors: true })));
  }

  /** The cells of the floor, and its walls where no surface shows them. */
  _addFloor(group, hasWalls) {
    const { data, layers, dark } = this._view, walls = [];
    for (const tile of data.floor) {
      const span = tile.side * tile.size;
      if (layers.floor || layers.viewed) {
        const texture = new THREE.CanvasTexture(this._view.pictureOf(tile));
        texture.magFilter = texture.minFilter = THREE.NearestFilter;
        texture.generateMipmaps = false;
        texture.colorSpace = THREE.SRGBColorSpace;
        const material = new THREE.MeshBasicMaterial({ map: texture, transparent: true, depthWrite: false, side: THREE.DoubleSide });
        const mesh = new THREE.Mesh(new THREE.PlaneGeometry(span, span), material);
        mesh.renderOrder = GROUND;
        mesh.position.copy(this.at(tile.x + span / 2, tile.y + span / 2, tile.z));
        group.add(mesh);
      }
      if (layers.floor && hasWalls) walls.push(...wallsOf(tile));
    }
    if (walls.length) group.add(this._boxes(walls, dark ? "#7d8a96" : "#8a949e"));
  }

  /** Boxes [x, y, z, dx, dy, dz, colour?] as one mesh; x, y, z [m] are the centre. */
  _boxes(boxes, colour, opacity = 1) {
    const material = new THREE.MeshLambertMaterial({ color: colour, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
    const mesh = new THREE.InstancedMesh(UNIT, material, boxes.length), matrix = new THREE.Matrix4();
    boxes.forEach(([x, y, z, dx, dy, dz, own], n) => {
      mesh.setMatrixAt(n, matrix.makeScale(dx, dy, dz).setPosition(this.at(x, y, z)));
      if (own) mesh.setColorAt(n, new THREE.Color(own));
    });
    return mesh;
  }

  _addPlaces(group) {
    for (const place of this._view.data.places.values()) {
      const colour = hexOf(this._view.colourOfPlace(place)), chosen = place.iri === this._view.selected;
      const rings = place.rings.map((ring) => ring.map(([x, y]) => this.over(x, y, 0.01)));
      const shape = new THREE.Shape(rings[0]);
      shape.holes = rings.slice(1).map((ring) => new THREE.Path(ring));
      const tint = { color: colour, transparent: true, opacity: chosen ? 0.28 : 0.14, depthWrite: false, side: THREE.DoubleSide };
      const floor = new THREE.Mesh(new THREE.ShapeGeometry(shape), new THREE.MeshBasicMaterial(tint));
      floor.position.z = this.ground;
      floor.renderOrder = GROUND + 1;
      group.add(floor, ...rings.map((ring) => lineOf(ring, colour, true)));
    }
    for (const door of this._view.data.doors) {
      group.add(lineOf([this.at(door.x, door.y), this.over(door.x, door.y, WALL)], hexOf(this._view.accent)));
    }
  }

  _addObjects(group) {
    const view = this._view, shades = new Map(), sides = [], colours = [];
    for (const one of view.data.objects.values()) {
      if (!view.shown(one)) continue;
      const shade = Math.round(Math.max(one.existence, 0.2) * SHADES);
      if (!shades.has(shade)) shades.set(shade, []);
      shades.get(shade).push(one);
    }
    const many = view.data.objects.size > MANY;
    this.meshes = [...shades].map(([shade, things]) => {
      const boxes = things.map((one) => [...boxOf(one, view.layers.boxes), hexOf(view.colourOfClass(one.class))]);
      const mesh = this._boxes(boxes, "#ffffff", FACE * shade / SHADES);
      mesh.things = things;
      things.forEach((one, n) => { if (!many || one.iri === view.selected) this._addEdges(one, boxes[n], sides, colours); });
      return mesh;
    });
    const edges = new THREE.BufferGeometry();
    edges.setAttribute("position", new THREE.Float32BufferAttribute(sides, 3));
    edges.setAttribute("color", new THREE.Float32BufferAttribute(colours, 3));
    group.add(...this.meshes, new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ vertexColors: true })));
    this._addSelection(group);
  }

  _addEdges(one, [x, y, z, dx, dy, dz, own], sides, colours) {
    const chosen = one.iri === this._view.selected, middle = this.at(x, y, z), grown = chosen ? 1.06 : 1;
    const colour = new THREE.Color(chosen ? hexOf(this._view.ink) : own);
    for (let n = 0; n < EDGES.count; n++) {
      sides.push(middle.x + EDGES.getX(n) * dx * grown, middle.y + EDGES.getY(n) * dy * grown, middle.z + EDGES.getZ(n) * dz * grown);
      colours.push(colour.r, colour.g, colour.b);
    }
  }

  /** A line down to the floor, and the sphere that contains the position with a probability of 95 %. */
  _addSelection(group) {
    const one = this._view.data.objects.get(this._view.selected);
    if (!one) return;
    const ink = hexOf(this._view.ink), middle = this.at(one.x, one.y, one.z);
    group.add(lineOf([middle, this.at(one.x, one.y)], ink));
    if (!one.deviation) return;
    const material = new THREE.MeshBasicMaterial({ color: ink, wireframe: true, transparent: true, opacity: 0.18 });
    const sphere = new THREE.Mesh(new THREE.SphereGeometry(2.8 * one.deviation, 16, 10), material); // in three dimensions
    sphere.position.copy(middle);
    group.add(sphere);
  }

  _addRobot(group, trail) {
    const { robot } = this._view.data, colour = hexOf(this._view.accent);
    if (this._view.layers.trail && trail.length > 1) group.add(lineOf(trail.map(([x, y]) => this.over(x, y, 0.03)), colour));
    if (!robot) return;
    const arrow = new THREE.Shape([[0.36, 0], [-0.27, 0.24], [-0.15, 0], [-0.27, -0.24]].map(([x, y]) => new THREE.Vector2(x, y)));
    const mesh = new THREE.Mesh(new THREE.ShapeGeometry(arrow), new THREE.MeshBasicMaterial({ color: colour, side: THREE.DoubleSide }));
    mesh.position.copy(this.over(robot.x, robot.y, 0.05));
    mesh.rotation.z = robot.heading;
    group.add(mesh);
  }

  /** The path of a plan, and a block at each stop. */
  _addPlan(group) {
    const { plan, accent } = this._view, colour = hexOf(accent);
    if (!plan) return;
    const way = plan.steps.flatMap((step) => [...(step.way || []), [step.x, step.y]]);
    group.add(lineOf([plan.start, ...way].map(([x, y]) => this.over(x, y, 0.04)), colour));
    group.add(this._boxes(plan.steps.map((step) => [step.x, step.y, this.ground + 0.05, 0.16, 0.16, 0.1]), colour));
  }
}

/** Centre and sides [m] of an object's box; a small cube unless `sized`. */
export function boxOf(one, sized) {
  const sides = sized && one.dx ? [one.dx, one.dy, one.dz].map((side) => Math.max(side, MIN_SIDE)) : [SMALL, SMALL, SMALL];
  return [one.x, one.y, one.z ?? 0, ...sides];
}

let context; // that reads colours

/** A CSS colour in the form of three.js. */
export function hexOf(colour) {
  const c = context ??= document.createElement("canvas").getContext("2d");
  c.fillStyle = colour;
  return c.fillStyle;
}

/** Boxes over the wall cells of a tile; adjacent cells of a row are one box. */
function wallsOf(tile) {
  const { side, size, cells } = tile, found = [];
  for (let x = 0; x < side; x++) {
    for (let y = 0, from = -1; y <= side; y++) {
      const wall = y < side && cells[x * side + y] === TALL;
      if (wall && from < 0) from = y;
      if (wall || from < 0) continue;
      found.push([tile.x + (x + 0.5) * size, tile.y + (from + y) / 2 * size, (tile.z ?? 0) + WALL / 2, size, (y - from) * size, WALL]);
      from = -1;
    }
  }
  return found;
}

function lineOf(points, colour, closed = false) {
  const geometry = new THREE.BufferGeometry().setFromPoints(points), material = new THREE.LineBasicMaterial({ color: colour });
  return closed ? new THREE.LineLoop(geometry, material) : new THREE.Line(geometry, material);
}

/** Remove a group from the scene and from graphics memory. */
function discard(scene, group) {
  scene.remove(group);
  group.traverse((one) => {
    if (one.geometry && one.geometry !== UNIT) one.geometry.dispose();
    one.material?.map?.dispose();
    one.material?.dispose();
    if (one.isInstancedMesh) one.dispose();
  });
}
