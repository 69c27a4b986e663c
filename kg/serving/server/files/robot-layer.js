// The robot, its trail, and a plan.
import { tracePath } from "/files/map-drawing.js";

const REACH = 1.2; // [m] radius of the sector in the direction of view
const ARROW = [[12, 0], [-9, 8], [-5, 0], [-9, -8]]; // [px], towards +x

export function drawTrail(c, view) {
  if (!view.layers.trail || view.data.trail.length < 2) return;
  c.strokeStyle = view.accent;
  c.globalAlpha = 0.5;
  c.lineWidth = 2;
  tracePath(c, view.data.trail.map(([x, y]) => view.toScreen(x, y)));
  c.stroke();
  c.globalAlpha = 1;
}

export function drawRobot(c, view, taken) {
  const robot = view.data.robot;
  if (!robot) return;
  const [u, v] = view.toScreen(robot.x, robot.y);
  taken.take(u - 11, v - 11, 22, 22, true);
  c.save();
  c.translate(u, v);
  c.rotate(-robot.heading);
  tracePath(c, ARROW);
  c.closePath();
  c.fillStyle = view.accent;
  c.strokeStyle = view.panel;
  c.lineWidth = 2;
  c.stroke();
  c.fill();
  c.restore();
}

/** The steps of a plan: positions, directions of view, order. */
export function drawPlan(c, view, taken) {
  if (!view.plan) return;
  const { steps, start } = view.plan, stops = steps.map((step) => view.toScreen(step.x, step.y));
  c.strokeStyle = c.fillStyle = view.accent;
  c.lineWidth = 2;
  c.setLineDash([7, 5]);
  const way = steps.flatMap((step) => [...(step.way || []), [step.x, step.y]]);
  tracePath(c, [start, ...way].map(([x, y]) => view.toScreen(x, y)));
  c.stroke();
  c.setLineDash([]);
  c.globalAlpha = 0.18;
  steps.forEach((step, n) => drawSector(c, stops[n], step, view.scale));
  c.globalAlpha = 1;
  c.font = "600 12px system-ui, sans-serif";
  c.textAlign = "center";
  for (const [[u, v], numbers] of bySpot(stops)) {
    const text = numbers.join(", "), half = Math.max(c.measureText(text).width / 2 + 5, 10);
    taken.take(u - half, v - 10, 2 * half, 20, true);
    c.fillStyle = view.accent;
    c.beginPath();
    c.roundRect(u - half, v - 10, 2 * half, 20, 10);
    c.fill();
    c.fillStyle = view.panel;
    c.fillText(text, u, v + 4);
  }
  c.textAlign = "left";
}

/** Each position once, with the numbers of its steps. */
function bySpot(stops) {
  const spots = new Map();
  stops.forEach(([u, v], n) => {
    const key = `${Math.round(u)} ${Math.round(v)}`;
    if (!spots.has(key)) spots.set(key, [[u, v], []]);
    spots.get(key)[1].push(n + 1);
  });
  return spots.values();
}

function drawSector(c, [u, v], step, scale) {
  const half = Math.min(step.extent, 6.28) / 2;
  c.beginPath();
  c.moveTo(u, v);
  c.arc(u, v, REACH * scale, -step.heading - half, -step.heading + half);
  c.closePath();
  c.fill();
}
