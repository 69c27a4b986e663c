// The map as a picture on a canvas: floor, places, objects with labels that do not overlap, robot, plan.

const NEAR = 16; // [px] of a click from what it meant
const LABELS = 400; // drawn at once, at most; fewer while the map is being moved
const TRIED = 1500; // objects that a label is tried for
const MANY = 3000; // objects in view from which on they are small squares

/** A colour that a category always has. */
export function colourOf(label, dark) {
  let hash = 7;
  for (const c of label) hash = (hash * 31 + c.codePointAt(0)) >>> 0;
  const hue = (hash * 137.508) % 360;
  return `hsl(${hue.toFixed(0)} ${dark ? "65% 66%" : "62% 38%"})`;
}

export class MapView {
  constructor(canvas, data, shown) {
    this.canvas = canvas;
    this.data = data;
    this.shown = shown; // (object) -> whether the filters let it through
    this.layers = { floor: true, viewed: false, labels: true, boxes: true, trail: true };
    this.selected = null;
    this.plan = null;
    this.scale = 40; // [px/m]
    this.centre = [0, 0]; // [m]
    this.onPick = () => {};
    this._pictures = new Map(); // of tiles
    this._widths = new Map(); // of labels [px]
    this._colours = new Map(); // of categories
    this._fitted = false;
    this._listen();
    new ResizeObserver(() => this._resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this._pictures.clear(); this._colours.clear(); this.draw(); });
    this._resize();
  }

  /** Draw soon, once. */
  draw() {
    if (this._waiting) return;
    this._waiting = requestAnimationFrame(() => { this._waiting = 0; this._draw(); });
  }

  /** Draw without most names until the map has rested for a moment. */
  _move() {
    clearTimeout(this._rest);
    this._moving = true;
    this._rest = setTimeout(() => { this._moving = false; this.draw(); }, 150);
    this.draw();
  }

  /** Show all of the map. */
  fit() {
    const xs = [], ys = [];
    for (const place of this.data.places.values()) for (const ring of place.rings) for (const [x, y] of ring) { xs.push(x); ys.push(y); }
    for (const tile of this.data.floor) { if (!xs.length) { xs.push(tile.x, tile.x + tile.side * tile.size); ys.push(tile.y, tile.y + tile.side * tile.size); } }
    for (const one of this.data.objects.values()) if (this.shown(one)) { xs.push(one.x); ys.push(one.y); }
    if (!xs.length) return;
    const bound = (values) => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
    const [xmin, xmax] = bound(xs), [ymin, ymax] = bound(ys);
    this.centre = [(xmin + xmax) / 2, (ymin + ymax) / 2];
    this.scale = Math.min((this.width - 60) / (xmax - xmin + 0.4), (this.height - 60) / (ymax - ymin + 0.4), 250);
    this._fitted = true;
    this.draw();
  }

  /** Bring a point [m] into the middle. */
  goTo(x, y, scale = Math.max(this.scale, 70)) {
    this.centre = [x, y];
    this.scale = scale;
    this.draw();
  }

  toScreen(x, y) {
    return [this.width / 2 + (x - this.centre[0]) * this.scale, this.height / 2 - (y - this.centre[1]) * this.scale];
  }

  toMap(u, v) {
    return [this.centre[0] + (u - this.width / 2) / this.scale, this.centre[1] - (v - this.height / 2) / this.scale];
  }

  zoom(factor, u = this.width / 2, v = this.height / 2) {
    const [x, y] = this.toMap(u, v);
    this.scale = Math.min(Math.max(this.scale * factor, 0.5), 800);
    this.centre = [x - (u - this.width / 2) / this.scale, y + (v - this.height / 2) / this.scale];
    this._move();
  }

  _resize() {
    const box = this.canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
    this.width = box.width;
    this.height = box.height;
    this.canvas.width = Math.round(box.width * ratio);
    this.canvas.height = Math.round(box.height * ratio);
    if (!this._fitted) this.fit();
    this.draw();
  }

  _listen() {
    const pointers = new Map();
    let moved = 0, apart = 0;
    const at = (event) => { const box = this.canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
    this.canvas.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, at(event));
      this.canvas.setPointerCapture(event.pointerId);
      moved = 0;
      apart = 0;
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const now = at(event);
      pointers.set(event.pointerId, now);
      const others = [...pointers.values()];
      if (others.length === 2) {
        const distance = Math.hypot(others[0][0] - others[1][0], others[0][1] - others[1][1]);
        if (apart) this.zoom(distance / apart, (others[0][0] + others[1][0]) / 2, (others[0][1] + others[1][1]) / 2);
        apart = distance;
        moved = Infinity;
        return;
      }
      moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
      this.centre = [this.centre[0] - (now[0] - before[0]) / this.scale, this.centre[1] + (now[1] - before[1]) / this.scale];
      this._move();
    });
    const end = (event) => {
      if (pointers.delete(event.pointerId) && event.type === "pointerup" && moved < 6) this._pick(...at(event));
    };
    this.canvas.addEventListener("pointerup", end);
    this.canvas.addEventListener("pointercancel", end);
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400), ...at(event));
    }, { passive: false });
    this.canvas.addEventListener("keydown", (event) => {
      const step = 60 / this.scale;
      const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
      if (moves[event.key]) { this.centre = this.centre.map((c, n) => c + moves[event.key][n]); this.draw(); }
      else if (event.key === "+" || event.key === "=") this.zoom(1.25);
      else if (event.key === "-") this.zoom(0.8);
      else if (event.key === "0") this.fit();
      else return;
      event.preventDefault();
    });
  }

  _pick(u, v) {
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

  _draw() {
    const ratio = devicePixelRatio || 1, c = this.canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    this.dark = matchMedia("(prefers-color-scheme: dark)").matches;
    this.ink = style.getPropertyValue("--ink").trim();
    this.faint = style.getPropertyValue("--faint").trim();
    this.panel = style.getPropertyValue("--panel").trim();
    this.accent = style.getPropertyValue("--accent").trim();
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.fillStyle = this.panel;
    c.fillRect(0, 0, this.width, this.height);
    if (this.layers.floor || this.layers.viewed) this._floor(c);
    this._places(c);
    if (this.plan) this._plan(c);
    const taken = new Taken(this.width, this.height);
    taken.take(this.width - 50, 0, 50, 150, true); // the buttons
    this._objects(c, taken);
    if (this.layers.trail) this._trail(c);
    this._robot(c, taken);
    this._placeNames(c, taken);
    if (this.layers.labels) this._labels(c, taken);
    this._scaleBar(c);
  }

  _floor(c) {
    c.imageSmoothingEnabled = false;
    this._now = this.layers.viewed ? this._latest() : 0;
    for (const tile of this.data.floor) {
      const span = tile.side * tile.size, [u, v] = this.toScreen(tile.x, tile.y + span);
      if (u > this.width || v > this.height || u + span * this.scale < 0 || v + span * this.scale < 0) continue;
      c.drawImage(this._picture(tile), u, v, span * this.scale, span * this.scale);
    }
  }

  /** A tile's picture, a pixel a cell; kept, as tiles seldom change. */
  _picture(tile) {
    const key = `${this.layers.viewed}${this.dark}`;
    let kept = this._pictures.get(tile.cells);
    if (kept && kept.key === key && kept.viewed === tile.viewed) return kept.canvas;
    const n = tile.side, canvas = document.createElement("canvas");
    canvas.width = canvas.height = n;
    const image = new ImageData(n, n), now = this._now;
    const tones = this.dark ? [null, [42, 49, 56], [66, 76, 86], [150, 163, 176]] : [null, [241, 243, 245], [214, 219, 225], [92, 102, 112]];
    const m = tile.viewed ? Math.sqrt(tile.viewed.length / 2) : 0;
    for (let x = 0; x < n; x++) for (let y = 0; y < n; y++) {
      const state = tile.cells[x * n + y];
      if (!state) continue;
      let tone = tones[state];
      if (this.layers.viewed && m && state !== 3) {
        const when = tile.viewed[m * m + Math.floor(x * m / n) * m + Math.floor(y * m / n)];
        tone = when ? viewedTone(now - when, this.dark) : (this.dark ? [110, 60, 30] : [255, 205, 160]);
      }
      const at = ((n - 1 - y) * n + x) * 4;
      image.data.set(tone, at);
      image.data[at + 3] = 255;
    }
    canvas.getContext("2d").putImageData(image, 0, 0);
    if (this._pictures.size > 4000) this._pictures.clear();
    this._pictures.set(tile.cells, { key, viewed: tile.viewed, canvas });
    return canvas;
  }

  /** When floor was last viewed, in minutes since 1970. */
  _latest() {
    let latest = 0;
    for (const tile of this.data.floor) {
      tile.latest ??= tile.viewed ? tile.viewed.reduce((a, b) => Math.max(a, b), 0) : 0;
      latest = Math.max(latest, tile.latest);
    }
    return latest;
  }

  _places(c) {
    for (const place of this.data.places.values()) {
      const best = place.beliefs[0];
      c.beginPath();
      for (const ring of place.rings) {
        ring.forEach(([x, y], n) => { const [u, v] = this.toScreen(x, y); if (n) c.lineTo(u, v); else c.moveTo(u, v); });
        c.closePath();
      }
      const colour = best ? colourOf(this.data.labelOf(best[0]), this.dark) : this.faint;
      c.globalAlpha = this.layers.viewed ? 0.05 : 0.06 + 0.16 * (best ? best[1] : 0);
      c.fillStyle = colour;
      c.fill("evenodd");
      c.globalAlpha = place.iri === this.selected ? 1 : 0.55;
      c.lineWidth = place.iri === this.selected ? 3 : 1.2;
      c.strokeStyle = colour;
      c.stroke();
      c.globalAlpha = 1;
    }
    c.strokeStyle = this.accent;
    c.lineWidth = 3;
    for (const door of this.data.doors) {
      const [u, v] = this.toScreen(door.x, door.y);
      c.beginPath();
      c.arc(u, v, 3, 0, 7);
      c.stroke();
    }
  }

  _placeNames(c, taken) {
    c.textAlign = "center";
    for (const place of this.data.places.values()) {
      const best = place.beliefs[0];
      const name = best ? `${this.data.labelOf(best[0])} ${Math.round(best[1] * 100)} %` : this.data.nameOf(place);
      c.font = "600 13px system-ui, sans-serif";
      const width = c.measureText(name).width;
      if (width > (place.xmax - place.xmin) * this.scale - 6) continue;
      const [u, v] = this.toScreen((place.xmin + place.xmax) / 2, place.ymax);
      for (const drop of [16, 32, 48]) {
        if (!taken.take(u - width / 2, v + drop - 11, width, 14)) continue;
        this._text(c, name, u, v + drop, best ? colourOf(this.data.labelOf(best[0]), this.dark) : this.faint);
        break;
      }
    }
    c.textAlign = "left";
  }

  _objects(c, taken) {
    const dots = new Map();
    this._seen = [];
    for (const one of this.data.objects.values()) {
      if (!this.shown(one)) continue;
      const [u, v] = this.toScreen(one.x, one.y);
      if (u < -50 || v < -50 || u > this.width + 50 || v > this.height + 50) continue;
      this._seen.push([one, u, v]);
      const colour = this._colour(one.class);
      const key = `${colour}|${Math.round(Math.max(one.existence, 0.15) * 5)}`;
      if (!dots.has(key)) dots.set(key, []);
      dots.get(key).push([one, u, v]);
    }
    const many = this._seen.length > MANY, radius = many ? 2.5 : Math.min(Math.max(this.scale / 14, 3.5), 7);
    for (const [key, group] of dots) {
      const [colour, alpha] = key.split("|");
      c.fillStyle = c.strokeStyle = colour;
      if (this.layers.boxes && this.scale > 18 && !many) {
        c.lineWidth = 1;
        for (const [one, u, v] of group) {
          if (!one.dx) continue;
          const box = [u - one.dx * this.scale / 2, v - one.dy * this.scale / 2, one.dx * this.scale, one.dy * this.scale];
          c.globalAlpha = 0.08 * alpha / 5;
          c.fillRect(...box);
          c.globalAlpha = 0.45 * alpha / 5;
          c.strokeRect(...box);
        }
      }
      c.globalAlpha = alpha / 5;
      c.beginPath();
      for (const [, u, v] of group) {
        if (many) c.rect(u - 2, v - 2, 4, 4);
        else { c.moveTo(u + radius, v); c.arc(u, v, radius, 0, 7); }
      }
      c.fill();
    }
    c.globalAlpha = 1;
    for (const [, u, v] of this._seen.slice(0, TRIED)) taken.take(u - radius, v - radius, 2 * radius, 2 * radius, true);
    const chosen = this.data.objects.get(this.selected);
    if (chosen) this._halo(c, chosen, radius);
  }

  _colour(category) {
    if (!this._colours.has(category)) this._colours.set(category, colourOf(this.data.labelOf(category), this.dark));
    return this._colours.get(category);
  }

  _halo(c, one, radius) {
    const [u, v] = this.toScreen(one.x, one.y);
    c.strokeStyle = this.ink;
    c.lineWidth = 2;
    c.beginPath();
    c.arc(u, v, radius + 4, 0, 7);
    c.stroke();
    if (one.deviation) {
      c.setLineDash([4, 4]);
      c.lineWidth = 1;
      c.beginPath();
      c.arc(u, v, Math.max(2.45 * one.deviation * this.scale, radius), 0, 7); // holds 95 % in two dimensions
      c.stroke();
      c.setLineDash([]);
    }
  }

  _labels(c, taken) {
    c.font = "12px system-ui, sans-serif";
    const first = (a, b) => (b[0].iri === this.selected) - (a[0].iri === this.selected) || b[0].existence - a[0].existence || a[0].iri.length - b[0].iri.length || (a[0].iri < b[0].iri ? -1 : 1);
    const sorted = this._seen.length > MANY ? this._seen : [...this._seen].sort(first);
    const most = this._moving && sorted.length > LABELS ? LABELS / 8 : LABELS;
    let drawn = 0;
    for (const [one, u, v] of sorted.slice(0, this._moving ? TRIED / 8 : TRIED)) {
      if (drawn >= most) break;
      const name = this.data.nameOf(one).slice(0, 40);
      if (!this._widths.has(name)) this._widths.set(name, c.measureText(name).width);
      const width = this._widths.get(name);
      for (const [x, y] of [[u + 9, v + 4], [u - 9 - width, v + 4], [u - width / 2, v - 10], [u - width / 2, v + 20]]) {
        if (!taken.take(x - 1, y - 11, width + 2, 14)) continue;
        this._text(c, name, x, y, this.ink, Math.max(one.existence, 0.45));
        drawn++;
        break;
      }
    }
  }

  _text(c, text, x, y, colour, alpha = 1) {
    c.globalAlpha = alpha;
    c.lineWidth = 3;
    c.lineJoin = "round";
    c.strokeStyle = this.panel;
    c.strokeText(text, x, y);
    c.fillStyle = colour;
    c.fillText(text, x, y);
    c.globalAlpha = 1;
  }

  _trail(c) {
    const trail = this.data.trail;
    if (trail.length < 2) return;
    c.strokeStyle = this.accent;
    c.globalAlpha = 0.5;
    c.lineWidth = 2;
    c.beginPath();
    trail.forEach(([x, y], n) => { const [u, v] = this.toScreen(x, y); if (n) c.lineTo(u, v); else c.moveTo(u, v); });
    c.stroke();
    c.globalAlpha = 1;
  }

  _robot(c, taken) {
    const robot = this.data.robot;
    if (!robot) return;
    const [u, v] = this.toScreen(robot.x, robot.y);
    taken.take(u - 11, v - 11, 22, 22, true);
    c.save();
    c.translate(u, v);
    c.rotate(-robot.heading);
    c.beginPath();
    [[12, 0], [-9, 8], [-5, 0], [-9, -8]].forEach(([x, y], n) => (n ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.closePath();
    c.fillStyle = this.accent;
    c.strokeStyle = this.panel;
    c.lineWidth = 2;
    c.stroke();
    c.fill();
    c.restore();
  }

  /** The steps of a plan: where to stand, which way to look, in which order. */
  _plan(c) {
    const steps = this.plan.steps.map((step) => [...this.toScreen(step.x, step.y), step]);
    c.strokeStyle = this.accent;
    c.lineWidth = 2;
    c.setLineDash([7, 5]);
    c.beginPath();
    c.moveTo(...this.toScreen(...this.plan.start.slice(0, 2)));
    steps.forEach(([u, v]) => c.lineTo(u, v));
    c.stroke();
    c.setLineDash([]);
    steps.forEach(([u, v, step]) => {
      const half = Math.min(step.extent, 6.28) / 2, reach = 1.2 * this.scale;
      c.globalAlpha = 0.18;
      c.fillStyle = this.accent;
      c.beginPath();
      c.moveTo(u, v);
      c.arc(u, v, reach, -step.heading - half, -step.heading + half);
      c.closePath();
      c.fill();
      c.globalAlpha = 1;
    });
    c.font = "600 12px system-ui, sans-serif";
    c.textAlign = "center";
    steps.forEach(([u, v], n) => {
      c.fillStyle = this.accent;
      c.beginPath();
      c.arc(u, v, 10, 0, 7);
      c.fill();
      c.fillStyle = this.panel;
      c.fillText(String(n + 1), u, v + 4);
    });
    c.textAlign = "left";
  }

  _scaleBar(c) {
    const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200].find((m) => m * this.scale > 60) || 500;
    const x = 14, y = this.height - 16;
    c.strokeStyle = this.ink;
    c.lineWidth = 2;
    c.beginPath();
    c.moveTo(x, y - 4);
    c.lineTo(x, y);
    c.lineTo(x + metres * this.scale, y);
    c.lineTo(x + metres * this.scale, y - 4);
    c.stroke();
    c.font = "12px system-ui, sans-serif";
    this._text(c, `${metres} m`, x + 6, y - 6, this.ink);
  }
}

/** Rectangles of the screen that are taken, found by the squares of a grid that they touch. */
class Taken {
  constructor(width, height) {
    this._size = [width, height];
    this._cells = new Map();
  }

  /** Take a rectangle [px] if it is free and on the canvas, or in any case; whether it was taken. */
  take(x, y, width, height, always = false) {
    if (!always && (x < 2 || y < 2 || x + width > this._size[0] - 2 || y + height > this._size[1] - 2)) return false;
    const box = [x, y, x + width, y + height], keys = [];
    if (!(box[2] > 0 && box[3] > 0 && x < this._size[0] && y < this._size[1])) return always; // far off, or no number
    for (let i = Math.floor(x / 64); i <= Math.floor(box[2] / 64); i++) {
      for (let j = Math.floor(y / 64); j <= Math.floor(box[3] / 64); j++) keys.push(i * 4099 + j);
    }
    if (!always && keys.some((key) => (this._cells.get(key) || []).some((b) => b[0] < box[2] && box[0] < b[2] && b[1] < box[3] && box[1] < b[3]))) return false;
    keys.forEach((key) => { if (!this._cells.has(key)) this._cells.set(key, []); this._cells.get(key).push(box); });
    return true;
  }
}

/** Colour of floor that was last viewed so many minutes before the latest view. */
function viewedTone(minutes, dark) {
  const age = Math.min(Math.log1p(Math.max(minutes, 0)) / Math.log(60 * 24 * 7), 1);
  const [fresh, old] = dark ? [[36, 110, 80], [42, 49, 56]] : [[150, 220, 180], [225, 232, 238]];
  return fresh.map((value, n) => Math.round(value + (old[n] - value) * age));
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
