// Elements of a page, made by scripts: text is never markup.

export const byId = (id) => document.getElementById(id);

/** An element with text and children. */
export function element(name, text = "", ...children) {
  const made = document.createElement(name);
  made.textContent = text;
  made.append(...children);
  return made;
}

export function button(text, onClick) {
  const made = element("button", text);
  made.type = "button";
  made.addEventListener("click", onClick);
  return made;
}

export function option(value, text) {
  const made = element("option", text);
  made.value = value;
  return made;
}

/** A link to the page of an IRI on this server, whose things' IRIs begin with `base`; `//` would lead to another host. */
export function linkTo(iri, base, text) {
  const link = element("a", text), path = iri.startsWith(base) ? iri.slice(base.length) : null;
  link.href = path === null || path.startsWith("/") ? `/resource?iri=${encodeURIComponent(iri)}` : `/${path}`;
  return link;
}

/** Say something in the page's line of messages, which screen readers read out. */
export function status(text) {
  byId("status").textContent = text;
}
