"""Naming sheet: one HTML page with the pictures of a map's things, on which people name them."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from kg.maps.semantic_map import SemanticMap

MAX_THINGS: Final = 500  # on one page

_PAGE: Final = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<title>Names of things</title>
<style>
body {{ font: 15px system-ui, sans-serif; margin: 1.5em; max-width: 75em }}
main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(190px, 1fr)); gap: 1em }}
figure {{ margin: 0; padding: .6em; border: 1px solid #bbb; border-radius: 6px }}
img {{ height: 150px; max-width: 100%; object-fit: contain; display: block; margin: auto }}
input {{ width: 100%; box-sizing: border-box; font: inherit }}
</style></head><body>
<h1>Names of things</h1>
<p>Type a name below each thing that you know, then
<button id="save">save names.csv</button> and run
<code>hereabouts name MAP --from names.csv --by YOU</code>. Empty fields change nothing.</p>
<main>
{things}
</main>
<script>
document.getElementById("save").addEventListener("click", () => {{
  const quoted = (text) => `"${{text.replaceAll('"', '""')}}"`;
  const lines = [...document.querySelectorAll("input")].filter((one) => one.value.trim())
    .map((one) => `${{one.name}},${{quoted(one.value.trim())}}\\n`);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(lines, {{ type: "text/csv" }}));
  link.download = "names.csv";
  link.click();
}});
</script></body></html>
"""
_THING: Final = """<figure><img alt="" src="data:image/jpeg;base64,{picture}">
<figcaption>{short}: {category}{by}{place}<input name="{short}" maxlength="100"
 aria-label="name of {short}" autocomplete="off"></figcaption></figure>"""


@dataclass(frozen=True, slots=True)
class ThingToName:
    """A thing with a picture."""

    short: str  # object/17
    category: str  # label
    place: str  # label, or ""
    named_by: str  # who asserted the category, or ""
    picture: bytes  # JPEG


def things_to_name(semantic_map: SemanticMap) -> Iterator[ThingToName]:
    """The believed things that have pictures: those without a name first, then those not named."""
    catalogue = semantic_map.catalogue
    by = {a.subject: a.by for a in semantic_map.assertions.all() if a.property == "category"}
    places = {place.iri: place.label or "" for place in semantic_map.places()}
    found = []
    for record in (*semantic_map.objects(min_existence=0.5), *semantic_map.unnamed_things()):
        category = catalogue.by_iri(record.category)
        label = "" if category is None else category.label
        found.append((record, label, by.get(record.iri, "")))
    found.sort(key=lambda one: (bool(one[2]), one[1] != "unnamed thing"))
    for record, label, author in found:
        if (picture := semantic_map.picture(record.iri)) is not None:
            short = record.iri.removeprefix(semantic_map.base)
            yield ThingToName(short, label, places.get(record.place or "", ""), author, picture)


def naming_sheet(semantic_map: SemanticMap, things: Sequence[ThingToName]) -> str:
    """The page with the things of `things_to_name`; it needs nothing from elsewhere."""
    title = semantic_map.description.title or ""
    figures = [
        _THING.format(
            picture=base64.b64encode(one.picture).decode(),
            short=escape(one.short),
            category=escape(one.category),
            by=f", named by {escape(one.named_by)}" if one.named_by else "",
            place=f", {escape(one.place)}" if one.place else "",
        )
        for one in things
    ]
    page = _PAGE.format(things="\n".join(figures) or "<p>No thing of this map has a picture.</p>")
    return page.replace("<h1>Names of things</h1>", f"<h1>Names of things {escape(title)}</h1>")
