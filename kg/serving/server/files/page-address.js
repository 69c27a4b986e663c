// The address of the page holds all that is shown: a reload or a shared link brings it back.
//
// After # comes the path of the selected thing, then after ? the rest: view, layers, filters, time, comparison, search.
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
    this._given = null; // while an address is followed, it is not written
  }

  /** Write the address soon. */
  write() {
    if (this._given) return;
    clearTimeout(this._timer);
    this._timer = setTimeout(() => this.writeNow(), PAUSE);
  }

  /** Write the address. */
  writeNow() {
    if (!this._given) history.replaceState(null, "", this._now());
  }

  _now() {
    const { _view: view, _data: data } = this, boxes = all("[data-layer]");
    const hasOther = boxes.some((box) => box.checked !== box.defaultChecked);
    const given = {
      at: data.time ?? "",
      from: this._changes.from ?? "",
      view: view.isFitted ? "" : [...view.centre, view.scale].map((value) => value.toFixed(2)).join(","),
      solid: view.solid ? "1" : "",
      layers: hasOther ? boxes.filter((box) => box.checked).map((box) => box.dataset.layer).join(",") || "none" : "",
      find: this._search.wanted,
    };
    for (const id of FILTERS) given[id] = byId(id).value === defaultOf(byId(id)) ? "" : byId(id).value;
    if (given["in-place"]) given["in-place"] = data.pathOf(given["in-place"]);
    return addressOf(view.selected ? data.pathOf(view.selected) : "", given);
  }

  /** Set fields and layers by an address, then the moment, the comparison and the search; returns whether it has a view. */
  async follow(given, { show, turn, filter }) {
    this._given = given;
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
      if (given.has("solid") !== Boolean(this._view.solid)) await turn();
      if ((given.get("find") ?? "") !== this._search.wanted) this._search.find(given.get("find") ?? "", { quiet: true });
      const [x, y, scale] = (given.get("view") ?? "").split(",").map(Number);
      if (!(scale > 0 && Number.isFinite(x) && Number.isFinite(y))) return false;
      this._view.goTo(x, y, scale);
      return true;
    } finally {
      this._given = null;
    }
  }
}

function defaultOf(field) {
  return field.defaultValue ?? field.options[0].value;
}
