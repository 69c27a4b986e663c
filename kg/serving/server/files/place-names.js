// Names of places, and where there is room for them.
import { inside } from "/files/map-drawing.js";

const LINES = 12; // of a place in which space for its name is searched
const WIDER = 1.5; // times its place a name may be, where nothing else is in the way

/** Names of a place, long and short: its own name, or its most probable category; a number tells several kitchens apart. */
export function namesOf(data, place) {
  const best = place.beliefs[0], own = data.nameOf(place);
  if (!best) return [own];
  const kind = data.labelOf(best[0]), share = `${Math.round(best[1] * 100)} %`, number = /^place (\d+)$/.exec(own);
  if (!number) return own.toLowerCase() === kind ? [`${own} ${share}`, own] : [`${own} (${kind} ${share})`, own];
  const isOne = [...data.places.values()].filter((other) => other.beliefs[0]?.[0] === best[0]).length === 1;
  return isOne ? [`${kind} ${share}`, kind] : [`${kind} ${number[1]} (${share})`, `${kind} ${number[1]}`];
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
