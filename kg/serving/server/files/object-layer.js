// Objects: a dot and a box each, fainter with lower existence, and names that do not overlap.
import { colourOf, drawText } from "/files/map-drawing.js";

const MAX_LABELS = 400; // drawn at once; fewer while the map moves
const TRIED = 1500; // objects for which space for a label is searched
const MANY = 3000; // with more objects in view, they are small squares
const BOXES = 18; // [px/m] at and above this scale boxes are drawn
const SHADES = 5; // steps of existence

export class ObjectLayer {
  constructor(view) {
    this._view = view;
    this._widths = new Map(); // of labels [px]
    this._colours = new Map(); // of categories
    this._seen = []; // [object, u, v] of the objects on the canvas
  }

  /** Forget the colours, which differ in a dark page. */
  forgetColours() {
    this._colours.clear();
  }

  draw(c, taken) {
    const view = this._view, groups = this._group(), many = this._seen.length > MANY;
    const radius = many ? 2.5 : Math.min(Math.max(view.scale / 14, 3.5), 7);
    for (const { colour, shade, members } of groups.values()) {
      c.fillStyle = c.strokeStyle = colour;
      if (view.layers.boxes && view.scale > BOXES && !many) drawBoxes(c, members, shade / SHADES, view.scale);
      c.globalAlpha = shade / SHADES;
      c.beginPath();
      for (const [, u, v] of members) {
        if (many) c.rect(u - 2, v - 2, 4, 4);
        else { c.moveTo(u + radius, v); c.arc(u, v, radius, 0, 7); }
      }
      c.fill();
    }
    c.globalAlpha = 1;
    for (const [, u, v] of this._seen.slice(0, TRIED)) taken.take(u - radius, v - radius, 2 * radius, 2 * radius, true);
    this._drawHalo(c, radius);
  }

  /** Draw the objects on the canvas by colour and shade, so that each is set once. */
  _group() {
    const view = this._view, groups = new Map();
    this._seen = [];
    for (const one of view.data.objects.values()) {
      if (!view.shown(one)) continue;
      const [u, v] = view.toScreen(one.x, one.y);
      if (u < -50 || v < -50 || u > view.width + 50 || v > view.height + 50) continue;
      this._seen.push([one, u, v]);
      const colour = this.colourOf(one.class), shade = Math.round(Math.max(one.existence, 0.15) * SHADES), key = `${colour}|${shade}`;
      if (!groups.has(key)) groups.set(key, { colour, shade, members: [] });
      groups.get(key).members.push([one, u, v]);
    }
    return groups;
  }

  colourOf(category) {
    if (!this._colours.has(category)) this._colours.set(category, colourOf(this._view.data.labelOf(category), this._view.dark));
    return this._colours.get(category);
  }

  /** A ring around the selected object, and one that contains its position with a probability of 95 %. */
  _drawHalo(c, radius) {
    const view = this._view, one = view.data.objects.get(view.selected);
    if (!one) return;
    const [u, v] = view.toScreen(one.x, one.y);
    c.strokeStyle = view.ink;
    c.lineWidth = 2;
    c.beginPath();
    c.arc(u, v, radius + 4, 0, 7);
    c.stroke();
    if (!one.deviation) return;
    c.setLineDash([4, 4]);
    c.lineWidth = 1;
    c.beginPath();
    c.arc(u, v, Math.max(2.45 * one.deviation * view.scale, radius), 0, 7); // in two dimensions
    c.stroke();
    c.setLineDash([]);
  }

  drawNames(c, taken) {
    const view = this._view, moving = view.isMoving;
    c.font = "12px system-ui, sans-serif";
    const sorted = this._seen.length > MANY ? this._seen : [...this._seen].sort(([a], [b]) => this._order(a, b));
    const most = moving && sorted.length > MAX_LABELS ? MAX_LABELS / 8 : MAX_LABELS;
    let drawn = 0;
    for (const [one, u, v] of sorted.slice(0, moving ? TRIED / 8 : TRIED)) {
      if (drawn >= most) break;
      const name = view.data.nameOf(one).slice(0, 40), width = this._width(c, name);
      const spots = [[u + 9, v + 4], [u - 9 - width, v + 4], [u - width / 2, v - 10], [u - width / 2, v + 20]];
      const spot = spots.find(([x, y]) => taken.take(x - 1, y - 11, width + 2, 14));
      if (!spot) continue;
      drawText(c, view, name, ...spot, view.ink, Math.max(one.existence, 0.45));
      drawn++;
    }
  }

  /** The selected object first, then by existence; of two equal objects the older one. */
  _order(a, b) {
    const selected = this._view.selected;
    return Number(b.iri === selected) - Number(a.iri === selected) || b.existence - a.existence || a.iri.length - b.iri.length || (a.iri < b.iri ? -1 : 1);
  }

  _width(c, name) {
    if (!this._widths.has(name)) this._widths.set(name, c.measureText(name).width);
    return this._widths.get(name);
  }
}

function drawBoxes(c, members, alpha, scale) {
  c.lineWidth = 1;
  for (const [one, u, v] of members) {
    if (!one.dx) continue;
    const box = [u - one.dx * scale / 2, v - one.dy * scale / 2, one.dx * scale, one.dy * scale];
    c.globalAlpha = 0.08 * alpha;
    c.fillRect(...box);
    c.globalAlpha = 0.45 * alpha;
    c.strokeRect(...box);
  }
}
