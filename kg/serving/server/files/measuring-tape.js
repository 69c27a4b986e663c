// Distances between two points that are clicked.
import { byId, status } from "/files/page-elements.js";

export class MeasuringTape {
  constructor(view) {
    this._view = view;
    this._isOut = false;
    byId("measure").addEventListener("click", () => this._turn(!this._isOut));
    document.addEventListener("keydown", (event) => { if (this._isOut && event.key === "Escape") this._turn(false); });
  }

  /** Take a clicked point [m]; false if nothing is being measured. */
  take(point) {
    if (!this._isOut) return false;
    const { measured } = this._view;
    this._view.measured = measured.length === 1 ? [...measured, point] : [point];
    this._tell();
    this._view.draw();
    return true;
  }

  _turn(isOut) {
    this._isOut = isOut;
    this._view.measured = [];
    byId("measure").setAttribute("aria-pressed", String(isOut));
    if (isOut) byId("canvas").focus();
    this._tell();
    this._view.draw();
  }

  _tell() {
    const { measured, isFlat } = this._view;
    if (!this._isOut) return status("");
    if (measured.length < 2) return status(`click the ${measured.length ? "second" : "first"} point; the space bar takes the middle of the map, Escape ends`);
    const up = measured[1][2] - measured[0][2];
    return status(`${this._view.distance().toFixed(2)} m apart${isFlat ? "" : `, ${Math.abs(up).toFixed(2)} m of it in height`}`);
  }
}
