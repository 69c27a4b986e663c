"""ConceptNet's interface and names, and the thesis' table 6.1."""

import subprocess
import sys
import unicodedata
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.knowledge.conceptnet.importing import ConceptNetImport, import_conceptnet
from kg.knowledge.conceptnet.names import TermMatcher, reduced
from kg.knowledge.conceptnet.reading import ApiClient, ResponseCache
from kg.model import vocabulary as v
from kg.model.errors import ConceptNetError
from tests.shipped_ontology import CATALOGUE

Serve = Callable[[list[dict[str, Any]]], Any]
AsEdge = Callable[..., dict[str, Any]]


class Clock:
    """Time that passes only where somebody sleeps."""

    def __init__(self) -> None:
        self.now = 0.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


def client_of(service: Any, cache: Path | None = None) -> tuple[ApiClient, Clock]:
    clock = Clock()
    kept = ResponseCache(cache) if cache else None
    return ApiClient(service.address, kept, clock, clock.sleep), clock


def asked(client: ApiClient, **query: str) -> list[object]:
    """All edges of a query; the connection is closed."""
    with closing(client):
        return [*client.edges(**query or {"end": "/c/en/kitchen"})]


def test_all_pages_are_read_and_by_relative_address(serve: Serve, as_edge: AsEdge) -> None:
    service = serve([as_edge("AtLocation", f"thing {n}", "kitchen") for n in range(2500)])
    client, _ = client_of(service)
    found = asked(client, end="/c/en/kitchen", rel="/r/AtLocation")
    assert len({edge["@id"] for edge in found}) == len(found) == 2500  # type: ignore[index]
    assert client.statistics.requests == 3
    assert asked(client, end="/c/en/nowhere") == []  # HTTP 200 with "error"


def test_a_busy_service_is_asked_again_after_as_long_as_it_wants(serve, as_edge):
    service = serve([as_edge("AtLocation", "cup", "kitchen")])
    service.failures = [(429, {"Retry-After": "30"}), (502, {}), (503, {})]
    client, clock = client_of(service)
    assert len(asked(client)) == 1
    assert clock.slept == [30.0, 2.0, 4.0]


def test_a_service_that_is_down_is_given_up_with_a_way_out(serve: Serve) -> None:
    service = serve([])
    service.failures = [(502, {})] * 5
    client, clock = client_of(service)
    with pytest.raises(ConceptNetError, match=r"answers 502 .*5 times; .*often down.*--from FILE"):
        asked(client)
    assert clock.slept == [1.0, 2.0, 4.0, 8.0]


def test_nobody_at_the_address_is_one_line(serve: Serve) -> None:
    client, _ = client_of(serve([]))
    client.address = "http://127.0.0.1:9/"
    with pytest.raises(ConceptNetError, match=r"cannot be reached \(ConnectionError\), 5 times"):
        asked(client)


@pytest.mark.parametrize(
    ("garbage", "complaint"),
    [
        (b"<html>welcome</html>", "did not answer JSON"),
        (b"[" * 100_000, "did not answer JSON"),
        (b"[]", "JSON without edges"),
        (b'{"edges": 3}', "JSON without edges"),
        (
            b'{"edges": [1], "view": {"nextPage": "http://example.org/x"}}',
            "a next page on another server",
        ),
        (b'{"edges": [1], "view": {"nextPage": "/query?same"}}', "repeats a page"),
    ],
)
def test_what_is_not_conceptnet_is_one_line(serve: Serve, garbage: bytes, complaint: str) -> None:
    service = serve([])
    service.garbage = garbage
    with pytest.raises(ConceptNetError, match=complaint):
        asked(client_of(service)[0])


def test_a_wrong_route_is_not_tried_again(serve: Serve) -> None:
    service = serve([])
    client, _ = client_of(service)
    client.address += "wiki/"
    with pytest.raises(ConceptNetError, match="answers 404"):
        asked(client)
    assert len(service.asked) == 1


def test_edges_that_are_none_are_counted(serve: Serve, as_edge: AsEdge) -> None:
    bad = [as_edge("AtLocation", "cup", "kitchen", 2.0) for _ in range(3)]
    bad[0]["weight"] = -1
    bad[1]["end"] = {"@id": 7}
    bad[2]["rel"] = None
    service = serve([])
    service.query = lambda asked: bad if asked.get("end") == "/c/en/kitchen" else []
    client, _ = client_of(service)
    imported = import_conceptnet(service.address, client=client)
    assert imported.skipped == {"weight is no number above 0": 1, "no edge": 2}
    assert imported.found == ()


def test_requests_are_a_second_apart_as_3600_an_hour_allow(serve: Serve) -> None:
    client, clock = client_of(serve([]))
    sent = []
    for number in range(5):
        assert not asked(client, node=f"/c/en/thing_{number}")
        sent.append(clock.now)
        clock.now += 0.3 * number  # the client's own work counts
    assert sent == pytest.approx([0, 1, 2, 3, 4])


TINY = """@prefix here: <https://w3id.org/hereabouts#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
here:Object a owl:Class . here:Place a owl:Class .
here:Bed a owl:Class ; rdfs:subClassOf here:Object ; rdfs:label "bed" .
here:Cup a owl:Class ; rdfs:subClassOf here:Object ; rdfs:label "cup" .
here:Bedroom a owl:Class ; rdfs:subClassOf here:Place ; rdfs:label "bedroom" .
"""


def test_an_import_that_broke_off_goes_on_and_comes_to_the_same(serve, as_edge, tmp_path):
    folder = tmp_path / "tiny"
    folder.mkdir()
    (folder / "tiny.ttl").write_text(TINY)
    service = serve([as_edge("AtLocation", "bed", "bedroom", 7.0), as_edge("IsA", "cup", "thing")])

    def run(into: str) -> ConceptNetImport:
        client, _ = client_of(service, tmp_path / "cache")
        return import_conceptnet(service.address, tmp_path / into, ontologies=folder, client=client)

    whole = run("whole.ttl")
    once = len(service.asked)
    assert whole.requests == once > 10
    (bed,) = whole.found
    assert (bed.key, bed.weight) == ((v.LOCATED_AT, v.HERE + "Bed", v.HERE + "Bedroom"), 7.0)
    assert bed.licenses == (v.LICENSES + "by/4.0/",)

    for path in sorted((tmp_path / "cache").iterdir())[:6]:
        path.write_text("{broken")
    service.failures = [(500, {})] * 7  # gives up before the missing six
    with pytest.raises(ConceptNetError, match="500"):
        run("again.ttl")
    assert not (tmp_path / "again.ttl").exists()
    run("again.ttl")
    assert (tmp_path / "again.ttl").read_bytes() == (tmp_path / "whole.ttl").read_bytes()
    assert len(service.asked) - once <= 6 + 7


def test_no_address_and_no_file_is_one_line() -> None:
    with pytest.raises(ConceptNetError, match="is no http"):
        ApiClient("ftp://example.org")


NAMES = TermMatcher(CATALOGUE)


@pytest.mark.parametrize(
    ("term", "kind", "label"),
    [
        *((name, "place", "living room") for name in ("live room", "livingroom", "living-room")),
        *(("wait room", "place", "waiting room"), ("office build", "place", "office building")),
        *(("your office", "place", "office"), ("butcher shop", "place", "butchers shop")),
        *(("dine table", "object", "dining table"), ("a cell phone", "object", "cell phone")),
        *(("scissor", "object", "scissors"), ("wine glasses", "object", "wine glass")),
        *(("knives", "object", "knife"), ("pot plant", "object", "potted plant")),
        *(("television", "object", "tv"), ("foods", "supercategory", "food")),
    ],
)
def test_a_term_finds_its_category(term: str, kind: str, label: str) -> None:
    assert NAMES.get(term, kind) == CATALOGUE.find(label, kind).iri


@pytest.mark.parametrize("term", ["bedding", "skiing", "plan", "notebook", "", "the"])
def test_a_term_that_only_looks_alike_finds_none(term: str) -> None:
    assert NAMES.get(term, "object") is None


def test_notebook_is_a_doubtful_name_of_the_laptop() -> None:
    laptop = CATALOGUE.find("laptop")
    assert NAMES.doubtful("notebooks") == laptop.iri
    assert "notebook" in NAMES.terms(laptop)


def test_every_category_is_found_by_each_of_its_names_or_shares_it() -> None:
    for kind, group in NAMES.groups.items():
        for category in group:
            assert NAMES.get(category.label, kind) == category.iri
            for name in category.synonyms:
                assert NAMES.get(name, kind) is not None, name


@settings(deadline=None)
@given(st.text())
def test_reducing_what_is_reduced_again_needs_no_more_words(text: str) -> None:
    # one character may stand for several words: a fraction for its two numbers
    assert len(reduced(text).split()) <= len(unicodedata.normalize("NFKC", text))
    NAMES.get(text, "object")


ROOT = Path(__file__).resolve().parents[4]


def test_the_table_in_the_documentation_is_the_one_computed(shared: Callable[[str], Path]) -> None:
    graph = shared("data/conceptnet/conceptnet4_en.graph.gz")
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.conceptnet", "table", str(graph)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == (ROOT / "lab/research/table_6_1.md").read_text()
    assert "bed in bedroom" in done.stdout.partition("here now")[2].partition("In the thesis")[0]
