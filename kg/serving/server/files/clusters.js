// Clusters: at low zoom, the objects of a square are one circle with their number.
import { BOXES } from "/files/map-scene.js";

const FEW = 400; // objects that are drawn one by one at any zoom
const SIDE = 48; // [px] of a square, at least
const kept = new WeakMap(); // view -> its last clusters

/** Clusters {x, y, count, one, spot} of the shown objects; null where they are drawn one by one. */
export function clustersOf(view) {
  const { drawn, scale } = view;
  if (!view.isFlat || scale >= BOXES || drawn.length <= FEW) return null;
  const side = 2 ** Math.ceil(Math.log2(SIDE / scale)), before = kept.get(view);
  const clusters = before?.drawn === drawn && before.side === side ? before.clusters : groupsOf(drawn, side);
  kept.set(view, { drawn, side, clusters });
  for (const cluster of clusters) cluster.spot = view.toScreen(cluster.x, cluster.y);
  return clusters;
}

/** The objects of each square [m] of the floor. Squares lie still, so that moving the map changes no group. */
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
