// The surface: coloured voxels of what the camera saw. Read from `/surface`, drawn from above and in three dimensions.
import { request } from "/files/server.js";

const CUT = 2; // [m] above the floor; what is higher would hide the room
const PATIENCE = 10000; // [ms] from one reading of the present to the next
const MAX_SIDE = 4096; // [px] of the picture from above

export class SurfaceLayer {
  constructor(view) {
    this._view = view;
    this.surface = null; // {size, points, colours}; points [m] of the map
    this._at = undefined; // the moment that was read
    this._sequence = -1; // of the map when the present was read
    this._time = 0; // [ms] when that was
    this._loading = new AbortController();
    this._picture = null;
  }

  /** The surface at the shown moment; null without one. It is read in the background. */
  current() {
    const { data, layers } = this._view;
    if (!layers.surface) return null;
    const isOld = data.past === null && data.sequence !== this._sequence && Date.now() - this._time > PATIENCE;
    if (data.past !== this._at || isOld) this._read(data.past, data.sequence);
    return this.surface?.points.length ? this.surface : null;
  }

  /** Draw the surface from above. */
  draw(c) {
    const surface = this.current();
    if (!surface) return;
    this._picture ??= pictureOf(surface, this._view.data.ground());
    const { canvas, xmin, ymax } = this._picture, [u, v] = this._view.toScreen(xmin, ymax), { scale } = this._view;
    c.imageSmoothingEnabled = false;
    c.drawImage(canvas, u, v, canvas.width * surface.size * scale, canvas.height * surface.size * scale);
  }

  async _read(at, sequence) {
    this._loading.abort();
    const { signal } = this._loading = new AbortController();
    if (at !== this._at) this._show(null); // nothing of another moment
    [this._at, this._sequence, this._time] = [at, sequence, Date.now()];
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
    this._picture = null;
    this._view.draw();
  }
}

/** The points [m] and colours of a surface below the cut, `(x, y, z)` relative to an origin, colours 0 to 1 (linear). */
export function pointsBelow({ points, colours }, origin, ground) {
  const places = [], tones = [];
  for (let n = 0; n < points.length; n += 3) {
    if (points[n + 2] > ground + CUT) continue;
    places.push(points[n] - origin[0], points[n + 1] - origin[1], points[n + 2]);
    for (let k = 0; k < 3; k++) tones.push((colours[n + k] / 255) ** 2.2);
  }
  return { places, tones };
}

/** The surface of an answer: a JSON header, then columns (kg/maps/surface/wire_format.py). */
function decoded(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const { size, origin, voxels } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const from = 4 + length + 4 * voxels, cells = new Int16Array(buffer.slice(from, from + 6 * voxels));
  const shades = new Uint8Array(buffer, from + 8 * voxels, 3 * voxels);
  const points = new Float32Array(3 * voxels), colours = new Uint8Array(3 * voxels);
  for (let n = 0; n < voxels; n++) for (let k = 0; k < 3; k++) {
    points[3 * n + k] = origin[k] + size * cells[k * voxels + n];
    colours[3 * n + k] = shades[k * voxels + n];
  }
  return { size, points, colours };
}

/** A picture of the highest voxels below the cut, one pixel each, and its corner [m]. */
function pictureOf({ size, points, colours }, ground) {
  let [xmin, xmax, ymin, ymax] = [Infinity, -Infinity, Infinity, -Infinity];
  for (let n = 0; n < points.length; n += 3) {
    xmin = Math.min(xmin, points[n]);
    xmax = Math.max(xmax, points[n]);
    ymin = Math.min(ymin, points[n + 1]);
    ymax = Math.max(ymax, points[n + 1]);
  }
  const canvas = document.createElement("canvas");
  canvas.width = Math.min(Math.round((xmax - xmin) / size) + 1, MAX_SIDE);
  canvas.height = Math.min(Math.round((ymax - ymin) / size) + 1, MAX_SIDE);
  const image = new ImageData(canvas.width, canvas.height);
  const top = new Float32Array(canvas.width * canvas.height).fill(-Infinity);
  for (let n = 0; n < points.length; n += 3) {
    const column = Math.round((points[n] - xmin) / size), row = Math.round((ymax - points[n + 1]) / size);
    const at = row * canvas.width + column;
    if (column >= canvas.width || row >= canvas.height || points[n + 2] > ground + CUT || points[n + 2] <= top[at]) continue;
    top[at] = points[n + 2];
    image.data.set([colours[n], colours[n + 1], colours[n + 2], 255], 4 * at);
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
  return { canvas, xmin: xmin - size / 2, ymax: ymax + size / 2 };
}
