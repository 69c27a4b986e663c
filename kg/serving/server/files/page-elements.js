// Elements of a page, created by scripts; text is never parsed as markup.

/** @type {(id: string) => any} */
export const byId = (id) => document.getElementById(id);

/** All elements that match a selector.
 * @type {(selector: string) => any[]} */
export const all = (selector) => [...document.querySelectorAll(selector)];

export const percent = (share) => (share > 0 && share < 0.0005 ? "under 0.1 %" : share >= 0.995 && share < 1 ? "over 99 %" : `${Number((100 * share).toFixed(share < 0.095 ? 1 : 0))} %`); // as kg.model.shares says it

/** A chance in per cent that is never certain, as kg.model.shares says it. */
export const chance = (probability) => percent(Math.min(probability, 0.999));

/** An element with text, properties and children.
 * @type {(name: string, text?: string, ...content: (Node | string | object)[]) => any} */
export function element(name, text = "", ...content) {
  const made = document.createElement(name), isGiven = (one) => one.constructor === Object;
  made.textContent = text;
  made.append(...content.filter((one) => !isGiven(one)));
  return Object.assign(made, ...content.filter(isGiven));
}

export const button = (text, onclick) => element("button", text, { type: "button", onclick });

/** A button that looks like a link. */
export const linkButton = (onclick, ...content) => element("button", "", { type: "button", className: "link", onclick }, ...content);

/** A list of the first entries that `make` makes of rows; the others are made once they are unfolded. */
export function folded(name, rows, most, make) {
  const list = element(name, "", ...rows.slice(0, most).map(make)), rest = rows.slice(most);
  if (rest.length) list.append(element("li", "", linkButton(({ target }) => target.closest("li").replaceWith(...rest.map(make)), `and ${rest.length} more`)));
  return list;
}

/** Show or hide an element by its id. */
export const reveal = (id, isShown) => { byId(id).classList.toggle("hidden", !isShown); };

/** Questions as buttons that ask them. */
export function examplesOf(questions) {
  const ask = (text) => { byId("wanted").value = text; byId("find").requestSubmit(); };
  return element("p", "", { className: "examples" }, ...questions.map((text) => button(text, () => ask(text))));
}

export const option = (value, text) => element("option", text, { value });

/** The name of a thing; a number that the map gave it appears under the pointer. */
export function named(data, one) {
  const [name, number] = data.partsOf(one);
  return element("span", name, ...number ? [element("span", ` ${number}`, { className: "nr" })] : []);
}

/** How sure something is, in words with a bar. */
export const sureness = (share, words = "sure") => element("span", `${chance(share)} ${words} `, element("meter", "", { value: share, ariaLabel: "how sure" }));

/** A context that draws on an empty canvas of its own, of so many pixels. */
export const drawing = (width, height) => element("canvas", "", { width, height }).getContext("2d");

/** A link to the page of an IRI on this server; IRIs of the map begin with `base`. A path with `//` would be another host. */
export function linkTo(iri, base, text) {
  const path = iri.startsWith(base) ? iri.slice(base.length) : "/";
  return element("a", text, { href: path.startsWith("/") ? `/resource?iri=${encodeURIComponent(iri)}` : `/${path}` });
}

/** Save data as a file; null, of a picture that could not be made, is told. */
export function save(file, blob) {
  if (!blob) { status("the picture cannot be made"); return; }
  const href = URL.createObjectURL(blob);
  element("a", "", { href, download: file }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60000);
}

/** Show a message in the page's status line, which screen readers read out. */
export const status = (text) => { byId("status").textContent = text; };
