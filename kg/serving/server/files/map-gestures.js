// Pointer, wheel and keys on the map: move, zoom, pick.

const STILL = 6; // [px] that a pointer may move during a click

/** Move, zoom and pick in a view by events of its canvas. */
export function listen(view) {
  const canvas = view.canvas;
  const at = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
  listenToPointers(view, at);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.zoom(Math.exp(-event.deltaY / 400), ...at(event));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => { if (pressed(view, event.key)) event.preventDefault(); });
}

function listenToPointers(view, at) {
  const pointers = new Map();
  let moved = 0, apart = 0;
  view.canvas.addEventListener("pointerdown", (event) => {
    pointers.set(event.pointerId, at(event));
    view.canvas.setPointerCapture(event.pointerId);
    moved = 0;
    apart = 0;
  });
  view.canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = at(event);
    pointers.set(event.pointerId, now);
    const [a, b] = pointers.values();
    if (b) {
      const distance = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (apart) view.zoom(distance / apart, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
      apart = distance;
      moved = Infinity;
      return;
    }
    moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
    view.pan(now[0] - before[0], now[1] - before[1]);
  });
  const end = (event) => {
    if (pointers.delete(event.pointerId) && event.type === "pointerup" && moved < STILL) view.pick(...at(event));
  };
  view.canvas.addEventListener("pointerup", end);
  view.canvas.addEventListener("pointercancel", end);
}

/** Execute the command of a key; false for a key without a command. */
function pressed(view, key) {
  const moves = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
  if (moves[key]) view.pan(...moves[key]);
  else if (key === "+" || key === "=") view.zoom(1.25);
  else if (key === "-") view.zoom(0.8);
  else if (key === "0") view.fit();
  else return false;
  return true;
}
