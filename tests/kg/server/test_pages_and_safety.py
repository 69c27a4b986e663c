"""Pages and documents of the map's things, and what keeps strangers out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import rdflib

from kg.errors import ServerError
from kg.server import BearerTokens, Limits, Settings

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from conftest import Served

CUP = "https://example.org/maps/flat/object/1"


def test_thing_as_page_and_as_turtle(served: Served) -> None:
    page = served.get("object/1", headers={"Accept": "text/html"})
    assert "cup 1" in page.text
    turtle = served.get("object/1", headers={"Accept": "text/turtle"})
    graph = rdflib.Graph().parse(data=turtle.text, format="turtle")
    assert (rdflib.URIRef(CUP), rdflib.RDFS.label, rdflib.Literal("cup 1")) in graph
    assert served.get("object/99").status_code == 404


def test_front_page_escapes_and_loads_nothing_from_afar(served: Served) -> None:
    page = served.get("", headers={"Accept": "text/html"})
    assert "flat &lt;1&gt;" in page.text
    assert "flat <1>" not in page.text
    assert "default-src 'none'" in page.headers["Content-Security-Policy"]


def test_limits_of_host_body_and_rate(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(body=1000, rate=0.01, burst=4))
    assert served.get("health", headers={"Host": "evil.example"}).status_code == 421
    long = served.post("sparql", data={"query": "#" * 2000})
    assert long.status_code == 413
    assert [served.get("health").status_code for _ in range(5)][-1] == 429


def test_weak_token_and_open_host_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    file.write_text("ann q7x-tiny\n")
    with pytest.raises(ServerError, match="16") as refused:
        BearerTokens.load(file)
    assert "q7x-tiny" not in str(refused.value)
    with pytest.raises(ServerError, match="--public"):
        Settings(host="0.0.0.0")
