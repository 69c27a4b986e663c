// The surface, coloured voxels of what the camera saw, and the floor: read, and as pictures from above.
import { drawing } from "/files/page-elements.js";
import { request } from "/files/server.js";

const PATIENCE = 10000; // [ms] from one reading of the surface of the present to the next
const SHEET = 16; // tiles along the side of a picture
const MAX_SIDE = 4096; // [px] of the picture of a surface
const OBSTACLE = 3;
const CELL = 0.1, AROUND = 4; // [m] of a column of voxels, at least; columns around one in which the outside is searched
const WALL = 1.2, OUTER = 0.3; // [m] of a wall, at least; how far to one side what was seen around it is, as a share
// free, low obstacles, walls
const TONES = { light: [null, [241, 243, 245], [214, 219, 225], [92, 102, 112]], dark: [null, [42, 49, 56], [66, 76, 86], [150, 163, 176]] };
/** Colours of the time of the last view: blue, grey and orange differ for all kinds of colour vision. */
export const VIEWED = {
  light: { fresh: [86, 160, 225], old: [225, 232, 238], never: [240, 178, 70] },
  dark: { fresh: [30, 110, 190], old: [42, 49, 56], never: [170, 105, 10] },
};

export class SurfaceReader {
  constructor(view) {
    this._view = view;
    this.surface = null; // {size, points, colours}; points [m] of the map
    this._at = undefined; // the moment that was read
    this._version = -1; // of the surface that was read
    this._time = 0; // [ms] when that was
    this._loading = new AbortController();
  }

  /** The surface at the shown moment; null without one. It is read in the background. */
  current() {
    const { data, layers } = this._view;
    if (!layers.surface) return null;
    const isOld = data.past === null && data.surface !== this._version && Date.now() - this._time > PATIENCE;
    if (data.past !== this._at || isOld) this._read(data.past, data.surface);
    return this.surface?.points.length ? this.surface : null;
  }

  async _read(at, version) {
    this._loading.abort();
    const { signal } = this._loading = new AbortController();
    if (at !== this._at) this._show(null); // nothing of another moment
    [this._at, this._version, this._time] = [at, version, Date.now()];
    try {
      const answer = await request(at === null ? "/surface" : `/surface?at=${at}`, { signal });
      const surface = decoded(await answer.arrayBuffer());
      if (!signal.aborted) this._show(surface);
    } catch {
      // without a surface, floor and boxes are shown; the next moment is read anew
    }
  }

  _show(surface) {
    this.surface = surface;
    this._view.draw();
    this._view.onSurface();
  }
}

/** The surface of an answer: a JSON header, then columns (kg/maps/surface/wire_format.py). */
function decoded(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const { size, origin, voxels } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const from = 4 + length + 4 * voxels, cells = new Int16Array(buffer.slice(from, from + 6 * voxels));
  const shades = new Uint8Array(buffer, from + 8 * voxels, 3 * voxels);
  const points = new Float32Array(3 * voxels), colours = new Uint8Array(4 * voxels).fill(255); // with alpha
  for (let n = 0; n < voxels; n++) for (let k = 0; k < 3; k++) {
    points[3 * n + k] = origin[k] + size * cells[k * voxels + n];
    colours[4 * n + k] = shades[k * voxels + n];
  }
  return { size, points, colours };
}

/** The floor as few pictures of many tiles each: {canvas, x, y, z, wide, high} [m], with the lower left corner.
 *
 * `viewed` paints the time of the last view, `dark` takes the colours of a dark page. */
export function floorSheets(tiles, { viewed, dark }) {
  const sheets = new Map(), latest = Math.max(0, ...tiles.map((tile) => tile.latest)), scheme = dark ? "dark" : "light";
  for (const tile of tiles) {
    const span = tile.side * tile.size, [column, row] = [Math.round((tile.x - tiles[0].x) / span), Math.round((tile.y - tiles[0].y) / span)];
    const [i, j] = [Math.floor(column / SHEET), Math.floor(row / SHEET)], key = [i, j, tile.side, tile.size, tile.z].join();
    if (!sheets.has(key)) {
      const { canvas } = drawing(SHEET * tile.side, SHEET * tile.side), side = SHEET * span;
      sheets.set(key, { canvas, x: tiles[0].x + i * side, y: tiles[0].y + j * side, z: tile.z, wide: side, high: side });
    }
    const image = imageOf(tile, viewed, latest, scheme), { canvas } = sheets.get(key);
    canvas.getContext("2d").putImageData(image, (column - i * SHEET) * tile.side, canvas.height - (row - j * SHEET + 1) * tile.side);
  }
  return [...sheets.values()];
}

/** [xmin, xmax, ymin, ymax] of points [m]. */
function boundsOf(points) {
  const most = (outer, k) => { let found = points[k]; for (let n = k; n < points.length; n += 3) found = outer(found, points[n]); return found; };
  return [0, 1].flatMap((k) => [most(Math.min, k), most(Math.max, k)]);
}

/** Where each voxel of an outer wall faces outwards: 0 to 254 for the angles of a full turn, 255 for all other voxels.
 *
 * A column is of an outer wall if it is tall, and nothing was seen on one of its sides. */
export function facingOf({ points }, ground) {
  const [xmin, xmax, ymin, ymax] = boundsOf(points), sides = [xmax - xmin, ymax - ymin], cell = CELL * Math.ceil(Math.max(...sides) / CELL / MAX_SIDE || 1);
  const [columns, rows] = sides.map((side) => Math.ceil(side / cell) + 2 * AROUND + 1);
  const cellOf = (n) => (AROUND + Math.floor((points[n + 1] - ymin) / cell)) * columns + AROUND + Math.floor((points[n] - xmin) / cell);
  const high = new Float32Array(columns * rows).fill(-Infinity), facing = new Uint8Array(columns * rows).fill(255), found = new Uint8Array(points.length / 3);
  for (let n = 0; n < points.length; n += 3) high[cellOf(n)] = Math.max(high[cellOf(n)], points[n + 2]);
  for (let at = 0; at < high.length; at++) {
    if (high[at] === -Infinity) continue;
    let [u, v, count, top] = [0, 0, 0, -Infinity];
    for (let j = -AROUND; j <= AROUND; j++) for (let i = -AROUND; i <= AROUND; i++) {
      const there = high[at + j * columns + i];
      if (there > -Infinity) { u -= i; v -= j; count++; }
      if (i * i + j * j <= 4) top = Math.max(top, there);
    }
    const far = Math.hypot(u, v), beyond = at + Math.round(3 * v / far) * columns + Math.round(3 * u / far);
    if (top > ground + WALL && far > OUTER * AROUND * count && high[beyond] === -Infinity) facing[at] = Math.round((Math.atan2(v, u) / Math.PI + 2) * 127) % 254;
  }
  return found.map((_, n) => facing[cellOf(3 * n)]);
}

/** The surface from above as one picture: {canvas, x, y, wide, high} [m]; a pixel is the highest voxel below `top` [m]. */
export function surfaceSheet({ size, points }, colours, top) {
  const [xmin, xmax, ymin, ymax] = boundsOf(points);
  const pixel = size * Math.ceil(Math.max(xmax - xmin, ymax - ymin) / size / MAX_SIDE || 1);
  const [columns, rows] = [xmax - xmin, ymax - ymin].map((side) => Math.round(side / pixel) + 1);
  const image = new ImageData(columns, rows), highest = new Float32Array(columns * rows).fill(-Infinity);
  const pixels = new Uint32Array(image.data.buffer), tones = new Uint32Array(colours.buffer);
  for (let n = 0; n < points.length; n += 3) {
    const at = Math.round((ymax - points[n + 1]) / pixel) * columns + Math.round((points[n] - xmin) / pixel), z = points[n + 2];
    if (z > top || z <= highest[at]) continue;
    highest[at] = z;
    pixels[at] = tones[n / 3];
  }
  const c = drawing(columns, rows);
  c.putImageData(image, 0, 0);
  return { canvas: c.canvas, x: xmin - pixel / 2, y: ymin - pixel / 2, wide: columns * pixel, high: rows * pixel };
}

/** A tile as a picture; `latest` is the time of the last view of all, in minutes since 1970. */
function imageOf(tile, viewed, latest, scheme) {
  const n = tile.side, image = new ImageData(n, n);
  const m = viewed && tile.viewed ? Math.sqrt(tile.viewed.length / 2) : 0; // number of view times along a side
  for (let x = 0; x < n; x++) for (let y = 0; y < n; y++) {
    const state = tile.cells[x * n + y];
    if (!state) continue;
    let tone = TONES[scheme][state];
    if (m && state !== OBSTACLE) {
      const when = tile.viewed[m * m + Math.floor(x * m / n) * m + Math.floor(y * m / n)];
      tone = when ? viewedTone(latest - when, scheme) : VIEWED[scheme].never;
    }
    const at = ((n - 1 - y) * n + x) * 4;
    image.data.set(tone, at);
    image.data[at + 3] = 255;
  }
  return image;
}

/** Colour of a cell whose last view was so many minutes before the latest view. */
function viewedTone(minutes, scheme) {
  const age = Math.min(Math.log1p(Math.max(minutes, 0)) / Math.log(60 * 24 * 7), 1);
  const { fresh, old } = VIEWED[scheme];
  return fresh.map((value, n) => Math.round(value + (old[n] - value) * age));
}
