// The surface: coloured voxels of what the camera saw, read from `/surface`.
import { request } from "/files/server.js";

const PATIENCE = 10000; // [ms] from one reading of the present to the next

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
