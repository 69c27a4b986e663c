// Pictures of objects above them: of the selected one, and of those that are near.
import { pictureOf } from "/files/thing-details.js";

const NEAR = 170; // [px/m] at and above which an object is near
const MAX_SHOWN = 12;
const MAX_KEPT = 300;
const SIDES = [44, 110]; // [px] of a picture, at least and at most
const WIDE = 0.3; // [m] of a picture, within these limits

export class ObjectPictures {
  constructor(view) {
    this._view = view;
    this._kept = new Map(); // IRI -> canvas, or null without a picture
  }

  /** Draw the pictures of objects {one, spot} where there is room: the selected one first. */
  draw(c, taken, found) {
    const { layers, selected, inFocus, isMoving } = this._view;
    const near = found.filter(({ one, spot }) => one.iri === selected || (layers.pictures && !inFocus && spot[2] >= NEAR));
    let shown = 0;
    for (const { one, spot: [u, v, scale] } of near) {
      if (shown >= MAX_SHOWN) break;
      const picture = this._of(one, isMoving);
      if (!picture) continue;
      const side = Math.min(Math.max(WIDE * scale, SIDES[0]), SIDES[1]), factor = side / Math.max(picture.height, picture.width / 2);
      const [wide, high] = [picture.width * factor, picture.height * factor], [x, y] = [u - wide / 2, v - high - 26];
      if (!taken.take(x - 2, y - 2, wide + 4, high + 4)) continue;
      c.fillStyle = this._view.hexOfClass(one.class);
      c.fillRect(x - 2, y - 2, wide + 4, high + 4);
      c.fillRect(u - 1, y + high, 2, 10);
      c.drawImage(picture, x, y, wide, high);
      shown++;
    }
  }

  /** The picture of an object; null until it is read, in the past, and where none is kept. */
  _of({ iri }, isMoving) {
    const { data } = this._view;
    if (data.past !== null) return null;
    if (!this._kept.has(iri) && !isMoving) {
      if (this._kept.size >= MAX_KEPT) this._kept.clear();
      this._kept.set(iri, null);
      pictureOf(data, iri).then((picture) => { this._kept.set(iri, picture); if (picture) this._view.draw(); }, () => {});
    }
    return this._kept.get(iri) ?? null;
  }
}
