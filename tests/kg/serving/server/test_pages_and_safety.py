"""Pages and documents of the map's things, and what keeps strangers out."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING
from urllib.parse import quote

import pytest
import rdflib

from kg.maps.object_pictures import ObjectPictures
from kg.model.errors import ServerError
from kg.model.records import Evidence, MapUpdate
from kg.serving.opening import create_map
from kg.serving.server import BearerTokens, Settings
from tests.kg.serving.server.conftest import BASE, thing

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Served

CUP = f"{BASE}object/1"


def test_thing_as_page_and_as_turtle(lasting: Served) -> None:
    page = lasting.get("object/1", headers={"Accept": "text/html"})
    assert "cup 1" in page.text
    turtle = lasting.get("object/1", headers={"Accept": "text/turtle"})
    graph = rdflib.Graph().parse(data=turtle.text, format="turtle")
    assert (rdflib.URIRef(CUP), rdflib.RDFS.label, rdflib.Literal("cup 1")) in graph
    assert lasting.get("object/99").status_code == 404


def test_what_stands_somewhere_has_a_link_to_its_place_on_the_map(lasting: Served) -> None:
    lasting.write("INSERT DATA { <urn:%41> a here:Cup ; rdfs:label 'odd' ; here:x 1 ; here:y 1 }")
    for path, fragment in (
        ("object/1", "object/1"),
        ("place/1", "place/1"),
        ("resource?iri=urn:%2541", "urn:%2541"),
        ("resource?iri=https://w3id.org/hereabouts%23Cup", None),
    ):
        page = lasting.get(path, headers={"Accept": "text/html"}).text
        assert (f'href="/#{fragment}"' in page) == (fragment is not None)
        assert ('href="/#' in page) == (fragment is not None)


def test_files_of_the_pages_are_sent_again_only_when_they_changed(lasting: Served) -> None:
    first = lasting.get("files/map-page.js")
    again = lasting.get("files/map-page.js", headers={"If-None-Match": first.headers["ETag"]})
    other = lasting.get("files/map-page.js", headers={"If-None-Match": '"another"'})
    assert (first.status_code, again.status_code, again.content) == (200, 304, b"")
    assert other.content == first.content
    for name in ("console.html", "../app.py", "vendor/../style.css", "vendor"):
        assert lasting.get(f"files/{quote(name, safe='')}").status_code == 404


def test_the_live_map_sends_less_than_62_kb_of_our_own_code(lasting: Served) -> None:
    waiting, read, sent = ["map-page.js"], dict[str, str](), 0
    while waiting:
        name = waiting.pop()
        answer = lasting.get(f"files/{name}", headers={"Accept-Encoding": "gzip"})
        read[name], sent = answer.text, sent + int(answer.headers["Content-Length"])
        imported = re.findall(r'"/files/([\w-]+\.js)"', read[name])
        waiting += [one for one in imported if one not in read and one not in waiting]
    assert len(read) > 15
    assert sent < 62_000


def test_all_scripts_of_the_map_are_asked_for_at_once(lasting: Served, private: Served) -> None:
    page = lasting.get("", headers={"Accept": "text/html"}).text
    asked = set(re.findall(r'<link rel="modulepreload" href="/files/([^"]+)">', page))
    imported = {"map-page.js"}
    for name in asked - {"vendor/three.min.js"}:
        imported |= set(re.findall(r'"/files/([\w./-]+\.js)"', lasting.get(f"files/{name}").text))
    assert asked == imported
    assert 'href="/state?" as="fetch"' in page
    secret = private.get("", headers={"Accept": "text/html"}).text
    assert "modulepreload" in secret
    assert "/state" not in secret  # which would be refused without a token


def test_front_page_escapes_and_loads_nothing_from_afar(lasting: Served) -> None:
    page = lasting.get("", headers={"Accept": "text/html"})
    assert "flat &lt;1&gt;" in page.text
    assert "flat <1>" not in page.text
    assert "default-src 'none'" in page.headers["Content-Security-Policy"]


def test_weak_token_and_open_host_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    file.write_text("ann q7x-tiny\n")
    with pytest.raises(ServerError, match="16") as refused:
        BearerTokens.load(file)
    assert "q7x-tiny" not in str(refused.value)
    with pytest.raises(ServerError, match="--public"):
        Settings(host="0.0.0.0")


def test_an_object_has_its_picture_or_none(tmp_path, on_disk):
    folder = tmp_path / "a.map"
    with create_map(folder, base=BASE) as semantic_map:
        seen = Evidence("frame-1", "flat", 1.7e9, (1.0, 2.0, 3.0, 4.0), 0.9, "a detector")
        cup = replace(thing(semantic_map, 1, "cup", 1.0, 0.5), evidence=seen)
        semantic_map.apply(MapUpdate(objects=(cup,)))
        ObjectPictures(folder).write(cup, b"\xff\xd8 a picture")
    with on_disk(folder, read_only=True) as served:
        picture = served.get("pictures/1")
        assert (picture.status_code, picture.content) == (200, b"\xff\xd8 a picture")
        assert picture.headers["Content-Type"] == "image/jpeg"
        for other in ("2", "1%00", "x", "9" * 40):
            assert served.get(f"pictures/{other}").status_code == 204, other
        assert served.get("pictures/..%2Fhistory.sqlite").status_code == 404
        (kept,) = (folder / "pictures").iterdir()
        kept.rename(tmp_path / "elsewhere.jpg")
        kept.symlink_to(tmp_path / "elsewhere.jpg")
        assert served.get("pictures/1").status_code == 204  # what is not the map's is not shown
