// The address of the page holds all that is shown: a reload or a shared link brings it back.
//
// After # comes the path of the selected thing, after ? the rest.
import { all, byId } from "/files/page-elements.js";

const FILTERS = ["filter", "in-place", "least", "age"]; // ids of fields
const PAUSE = 250; // [ms] after the last change until the address is written

/** The selected thing of an address, and the other parameters. */
export function readAddress(hash) {
  const [name, ...rest] = hash.replace(/^#/, "").split("?");
  let thing = name;
  try { thing = decodeURIComponent(name); } catch { /* a single percent sign: used unchanged */ }
  return { thing, given: new URLSearchParams(rest.join("?")) };
}

/** The address of a selected path and parameters, without those that are empty. */
function addressOf(path, given) {
  const thing = encodeURIComponent(path).replaceAll("%2F", "/").replaceAll("%3A", ":");
  const rest = new URLSearchParams(Object.entries(given).filter(([, value]) => value !== "" && value !== null));
  return `#${thing}${rest.size ? `?${rest}` : ""}`;
}

export class PageAddress {
  constructor({ data, view, changes, search }) {
    this._data = data;
    this._view = view;
    this._changes = changes;
    this._search = search;
    /** @type {any} */
    this._timer = 0;
    this._given = new URLSearchParams(); // until an address was followed, and while one is, none is written
    this._last = location.hash; // that was written or followed; another one waits to be followed
  }

  /** Write the address soon. */
  write() {
    if (this._given) return;
    clearTimeout(this._timer);
    this._timer = setTimeout(() => this.writeNow(), PAUSE);
  }

  /** Write the address. */
  writeNow() {
    if (this._given || location.hash !== this._last) return;
    history.replaceState(null, "", this._now());
    this._last = location.hash;
    sessionStorage.setItem("map", this._last); // where the page of a thing leads back to
  }

  _now() {
    const { _view: view, _data: data } = this, boxes = all("[data-layer]");
    const hasOther = boxes.some((box) => box.checked !== box.defaultChecked);
    const given = {
      at: data.time ?? "",
      from: this._changes.from ?? "",
      view: view.isFitted ? "" : this._camera(),
      solid: view.isFlat ? "" : "1",
      focus: view.isFocused ? "1" : "",
      cut: view.height ?? "",
      layers: hasOther ? boxes.filter((box) => box.checked).map((box) => box.dataset.layer).join(",") || "none" : "",
      find: this._search.wanted,
    };
    for (const id of FILTERS) given[id] = byId(id).value === defaultOf(byId(id)) ? "" : byId(id).value;
    if (given["in-place"]) given["in-place"] = data.pathOf(given["in-place"]);
    return addressOf(view.selected ? data.pathOf(view.selected) : "", given);
  }

  /** Where the camera looks; in three dimensions with its direction and height. */
  _camera() {
    const { x, y, scale, azimuth, polar, z } = this._view.camera.state;
    return [x, y, scale, ...(this._view.isFlat ? [] : [azimuth, polar, z])].map((value) => value.toFixed(2)).join(",");
  }

  /** Set fields and layers by an address, then the moment, the comparison and the search; returns whether it has a view.
   *
   * Without parameters everything stays. */
  async follow(given, { show, turn, cut, filter }) {
    this._last = location.hash;
    this._given = given.size ? given : null;
    if (!given.size) return false;
    clearTimeout(this._timer);
    try {
      for (const box of all("[data-layer]")) {
        const isOn = given.has("layers") ? given.get("layers").split(",").includes(box.dataset.layer) : box.defaultChecked;
        if (isOn !== box.checked) box.click();
      }
      const place = given.get("in-place");
      filter(Object.fromEntries(FILTERS.map((id) => [id, given.get(id) ?? defaultOf(byId(id))])), place && this._data.base + place);
      if ((given.get("at") ?? null) !== this._data.time) await show(given.get("at"));
      if (given.get("from") !== this._changes.from) await this._changes.compare(given.get("from"));
      if (given.has("solid") === this._view.isFlat) turn();
      const height = given.has("cut") ? Number(given.get("cut")) : null;
      if (Number.isFinite(height ?? 0)) cut(height);
      if ((given.get("find") ?? "") !== this._search.wanted) this._search.find(given.get("find") ?? "", { quiet: true });
      const numbers = (given.get("view") ?? "").split(",").map(Number), [x, y, scale, azimuth, polar, z] = numbers;
      if (!(scale > 0 && numbers.length >= 3 && numbers.every(Number.isFinite))) return false;
      this._view.camera.look(numbers.length < 6 ? { x, y, scale } : { x, y, scale, azimuth, polar, z });
      return true;
    } finally {
      this._given = null;
    }
  }
}

const defaultOf = (field) => field.defaultValue ?? field.options[0].value;
