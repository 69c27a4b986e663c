// The floor: its cells, or the time of their last view.

const MAX_TILES = 4000; // pictures in the cache
const OBSTACLE = 3;
// free, low obstacles, walls
const TONES = { light: [null, [241, 243, 245], [214, 219, 225], [92, 102, 112]], dark: [null, [42, 49, 56], [66, 76, 86], [150, 163, 176]] };
/** Colours of the time of the last view: blue, grey and orange differ for all kinds of colour vision. */
export const VIEWED = {
  light: { fresh: [86, 160, 225], old: [225, 232, 238], never: [240, 178, 70] },
  dark: { fresh: [30, 110, 190], old: [42, 49, 56], never: [170, 105, 10] },
};

export class FloorLayer {
  constructor(view) {
    this._view = view;
    this._pictures = new Map(); // picture of a tile by the text of its cells
  }

  draw(c) {
    const view = this._view;
    if (!view.layers.floor && !view.layers.viewed) return;
    c.imageSmoothingEnabled = false;
    for (const tile of view.data.floor) {
      const span = tile.side * tile.size, [u, v] = view.toScreen(tile.x, tile.y + span);
      if (u > view.width || v > view.height || u + span * view.scale < 0 || v + span * view.scale < 0) continue;
      c.drawImage(this.pictureOf(tile), u, v, span * view.scale, span * view.scale);
    }
  }

  /** A tile's picture, one pixel per cell; cached, since tiles seldom change. */
  pictureOf(tile) {
    const viewed = this._view.layers.viewed, scheme = this._view.dark ? "dark" : "light", key = `${viewed}${scheme}`;
    const kept = this._pictures.get(tile.cells);
    if (kept && kept.key === key && kept.viewed === tile.viewed) return kept.canvas;
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = tile.side;
    canvas.getContext("2d").putImageData(imageOf(tile, viewed, viewed ? this._latest() : 0, scheme), 0, 0);
    if (this._pictures.size > MAX_TILES) this._pictures.clear();
    this._pictures.set(tile.cells, { key, viewed: tile.viewed, canvas });
    return canvas;
  }

  /** The time of the last view, in minutes since 1970. */
  _latest() {
    let latest = 0;
    for (const tile of this._view.data.floor) {
      tile.latest ??= tile.viewed ? tile.viewed.reduce((a, b) => Math.max(a, b), 0) : 0;
      latest = Math.max(latest, tile.latest);
    }
    return latest;
  }
}

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
