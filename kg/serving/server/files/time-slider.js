// The time slider: selects a transaction of the map, or plays all.
import { byId, status } from "/files/page-elements.js";

const FRAMES = 120; // from the first transaction to the last when playing

export class TimeSlider {
  constructor(data) {
    this._data = data;
    this._slider = byId("time");
    this._timer = null;
    this._slider.addEventListener("input", () => this._show(Number(this._slider.value)));
    byId("play").addEventListener("click", () => (this._timer ? this._stop() : this._play()));
  }

  /** Set the end to the map's last transaction; stay at the end if the present is shown. */
  follow() {
    this._slider.max = this._data.last;
    if (this._data.past === null) this._slider.value = this._data.last;
  }

  async _show(sequence) {
    const present = sequence >= this._data.last;
    byId("moment").textContent = present ? "now" : `transaction ${sequence} of ${this._data.last}`;
    try {
      await this._data.load(present ? null : sequence);
    } catch (error) {
      status(error.message);
    }
  }

  _play() {
    if (Number(this._slider.value) >= this._data.last) this._slider.value = 1;
    byId("play").textContent = "stop";
    const step = Math.max(1, Math.round(this._data.last / FRAMES));
    let busy = false;
    this._timer = setInterval(async () => {
      if (busy) return;
      busy = true;
      const next = Math.min(Number(this._slider.value) + step, this._data.last);
      this._slider.value = next;
      await this._show(next);
      busy = false;
      if (next >= this._data.last) this._stop();
    }, 120);
  }

  _stop() {
    clearInterval(this._timer);
    this._timer = null;
    byId("play").textContent = "play";
  }
}
