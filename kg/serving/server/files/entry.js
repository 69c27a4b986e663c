// Entry to a private map: the page asks for a token once, and keeps it only in memory.
import { byId } from "/files/page-elements.js";
import { request, useToken } from "/files/server.js";

/** Wait until the map may be read; returns its base IRI. For a public map, `place` has it already. */
export function enter(place) {
  const form = byId("entry");
  if (!form) return Promise.resolve(place.dataset.base);
  byId("entry-token").focus();
  return new Promise((open) => form.addEventListener("submit", async (event) => {
    event.preventDefault();
    useToken(byId("entry-token").value.trim());
    try {
      const { map, base } = await (await request("/health", { accept: "application/json" })).json();
      byId("title").textContent = map;
      document.title = `${map} · hereabouts`;
      form.remove();
      document.querySelector("#links, footer")?.remove(); // its links would send no token
      open(base);
    } catch (error) {
      byId("entry-outcome").textContent = error.message;
    }
  }));
}
