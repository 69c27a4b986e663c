// Functions of drawing: colours, text and free space for it, points in polygons, circles that stand for many objects.
import { BOXES } from "/files/map-scene.js";
import { drawing } from "/files/page-elements.js";

const EDGE = 5, HIGH = 22; // [px] around a text, and of its picture
const MAX_SPRITES = 2000;
const sprites = new Map(); // pictures of texts
const LINES = 12; // of a place in which space for its name is searched
const WIDER = 1.5; // times its place a name may be, where nothing else is in the way
const FEW = 400; // objects that are drawn one by one at any zoom
const SIDE = 48; // [px] of the square of a cluster, at least
const clustered = new WeakMap(); // list of objects -> its last clusters

/** The colours of `hereabouts plot`, which stay apart for the colour-blind; lighter ones for a dark page. */
const PALETTE = {
  light: ["#0072b2", "#d55e00", "#007d5c", "#cc79a7", "#e69f00", "#6f2d91", "#56b4e9", "#7f3b08"],
  dark: ["#4fa8dc", "#f0894a", "#3db892", "#e0a3c4", "#f0b94a", "#b383d0", "#8accf2", "#c98a58"],
};

/** The colour of a category, always the same. */
export function colourOf(label, dark) {
  let hash = 7;
  for (const c of label) hash = (hash * 31 + c.codePointAt(0)) >>> 0;
  return PALETTE[dark ? "dark" : "light"][((hash >>> 7) + hash) % 8];
}

export const shortened = (name, most) => ([...name].length > most ? `${[...name].slice(0, most - 1).join("")}…` : name);

/** Text with an outline in the colour of the background; its picture is kept, since outlines cost much. */
export function drawText(c, view, text, x, y, colour, alpha = 1) {
  const ratio = c.getTransform().a, key = [text, c.font, colour, view.panel, ratio].join("|");
  if (!sprites.has(key)) {
    if (sprites.size > MAX_SPRITES) sprites.clear();
    sprites.set(key, spriteOf(text, { font: c.font, width: c.measureText(text).width }, view.panel, colour, ratio));
  }
  const sprite = sprites.get(key), at = (value) => Math.round(value * ratio) / ratio;
  c.globalAlpha = alpha;
  c.drawImage(sprite, at(x - EDGE), at(y - HIGH + EDGE), sprite.width / ratio, sprite.height / ratio);
  c.globalAlpha = 1;
}

function spriteOf(text, { font, width }, panel, colour, ratio) {
  const c = drawing(Math.ceil((width + 2 * EDGE) * ratio), Math.ceil(HIGH * ratio));
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  Object.assign(c, { font, lineWidth: 4, lineJoin: "round", strokeStyle: panel, fillStyle: colour });
  c.strokeText(text, EDGE, HIGH - EDGE);
  c.fillText(text, EDGE, HIGH - EDGE);
  return c.canvas;
}

/** Occupied rectangles of the screen, in a grid of squares. */
export class Taken {
  constructor(width, height) {
    this._size = [width, height];
    this._cells = new Map();
  }

  /** Occupy a rectangle [px] if it is free and on the canvas, or `always`; returns whether it was occupied. */
  take(x, y, width, height, always = false) {
    if (!always && (x < 2 || y < 2 || x + width > this._size[0] - 2 || y + height > this._size[1] - 2)) return false;
    const box = [x, y, x + width, y + height], keys = [];
    if (!(box[2] > 0 && box[3] > 0 && x < this._size[0] && y < this._size[1])) return always; // off the canvas, or not a number
    for (let i = Math.floor(x / 64); i <= Math.floor(box[2] / 64); i++) {
      for (let j = Math.floor(y / 64); j <= Math.floor(box[3] / 64); j++) keys.push(i * 4099 + j);
    }
    if (!always && keys.some((key) => (this._cells.get(key) || []).some((b) => b[0] < box[2] && box[0] < b[2] && b[1] < box[3] && box[1] < b[3]))) return false;
    keys.forEach((key) => { if (!this._cells.has(key)) this._cells.set(key, []); this._cells.get(key).push(box); });
    return true;
  }
}

/** Possible middles [u, v] of a name of this width [px] in a place of a flat map, line by line from the top. */
export function* spotsIn(view, place, width) {
  const [left, top, scale] = view.toScreen(place.xmin, place.ymax), [right, bottom] = view.toScreen(place.xmax, place.ymin);
  const aside = (right - left - width) / 2 - 6, middle = (left + right) / 2;
  for (let line = 0; aside > -3 && line < LINES && top + 16 * line + 16 < bottom; line++) {
    for (const shift of [0, -aside, aside]) {
      const [u, v] = [middle + shift, top + 16 * line + 16];
      if (inside(place.xmin + (u - left) / scale, place.ymax - (v - 5 - top) / scale, place.rings)) yield [u, v];
    }
  }
  if (width < WIDER * (right - left)) yield [middle, (top + bottom) / 2 + 5];
}

/** The corners [x, y] of an object's box, seen from above. */
export function footprintOf({ x, y, dx, dy, yaw = 0 }) {
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) =>
    [x + (a * dx * cos - b * dy * sin) / 2, y + (a * dx * sin + b * dy * cos) / 2]);
}

/** Whether a point lies within rings, by the even-odd rule. */
export function inside(x, y, rings) {
  let within = false;
  for (const ring of rings) {
    for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
      const [xi, yi] = ring[i], [xj, yj] = ring[j];
      if ((yi > y) !== (yj > y) && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) within = !within;
    }
  }
  return within;
}

/** Clusters {x, y, count, one, spot} of the shown objects; null where they are drawn one by one. */
export function clustersOf(view) {
  const { drawn, scale } = view;
  if (!view.isFlat || scale >= BOXES || drawn.length <= FEW) return null;
  const side = 2 ** Math.ceil(Math.log2(SIDE / scale)), before = clustered.get(drawn);
  const clusters = before?.side === side ? before.clusters : groupsOf(drawn, side);
  clustered.set(drawn, { side, clusters });
  for (const cluster of clusters) cluster.spot = view.toScreen(cluster.x, cluster.y);
  return clusters;
}

/** The objects of each square [m] of the floor; squares lie still while the map moves. */
function groupsOf(drawn, side) {
  const groups = new Map();
  for (const one of drawn) {
    const key = `${Math.floor(one.x / side)} ${Math.floor(one.y / side)}`;
    if (!groups.has(key)) groups.set(key, { x: 0, y: 0, count: 0, one, spot: null });
    const group = groups.get(key);
    group.count += 1;
    group.x += (one.x - group.x) / group.count;
    group.y += (one.y - group.y) / group.count;
  }
  return [...groups.values()];
}
