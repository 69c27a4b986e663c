"""`hereabouts describe`: title and licence, in the folder and over HTTP."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import rdflib
import requests

from hereabouts.cli import main
from kg.serving.opening import create_map, open_map
from tests.hereabouts.cli.test_serve import TOKEN, home, serve, tokens

__all__ = ["home", "serve", "tokens"]  # fixtures

CC_BY = "https://creativecommons.org/licenses/by/4.0/"
LICENCE = rdflib.DCTERMS.license


@pytest.fixture
def flat(tmp_path: Path) -> Path:
    create_map(tmp_path / "flat.map", title="flat", base="https://example.org/flat/").close()
    return tmp_path / "flat.map"


def test_a_licence_is_stored_exported_and_part_of_the_history(flat, prints, tmp_path):
    before = json.loads(prints("describe", flat, "--json"))
    assert (before["title"], before["licence"]) == ("flat", None)
    words = ("--licence", CC_BY, "--title", "my flat", "--by", "ann", "--json")
    after = json.loads(prints("describe", flat, *words))
    assert after == {**before, "title": "my flat", "licence": CC_BY}
    other = "https://creativecommons.org/publicdomain/zero/1.0/"
    prints("describe", flat, "--licence", other)
    with open_map(flat, read_only=True) as semantic_map:
        assert (semantic_map.description.title, semantic_map.sequence) == ("my flat", 2)
        assert [c.cause.by for c in semantic_map.history.changes()] == ["ann", None]
    for name in ("out.ttl", "out.nq"):
        prints("export", flat, "-o", tmp_path / name)
        text = (tmp_path / name).read_text()
        assert text.count("https://creativecommons.org/publicdomain/zero/1.0/") == 1
        assert CC_BY not in text


def test_check_asks_for_the_licence_and_does_not_fail(flat, capsys):
    assert main(["check", str(flat)]) == 0
    assert "no licence: `hereabouts describe" in capsys.readouterr().err
    assert main(["describe", str(flat), "--licence", CC_BY]) == 0
    assert main(["check", str(flat)]) == 0
    assert "no licence" not in capsys.readouterr().err.partition("transaction")[2]


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("--licence", "CC-BY-4.0"), "a licence is an absolute IRI such as https://creativecomm"),
        (("--title", " "), "a map's title needs at least one letter"),
    ],
)
def test_what_is_no_licence_and_no_title_is_refused(flat, words, error, capsys):
    assert main(["describe", str(flat), *words]) == 1
    assert error in capsys.readouterr().err
    with open_map(flat, read_only=True) as semantic_map:
        assert semantic_map.sequence == 0


def test_a_served_map_is_described_on_its_page_and_in_dcat(
    serve, home, tokens, prints, monkeypatch
):
    process = serve(home, "--token-file", tokens)
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", process.url)
    prints("describe", process.url, "--licence", CC_BY, "--title", "O'Neill's \"flat\"\\n")
    said = json.loads(prints("describe", process.url, "--json"))
    assert (said["title"], said["licence"]) == ("O'Neill's \"flat\"\\n", CC_BY)
    graph = rdflib.Graph().parse(process.url + ".well-known/void", format="turtle")
    assert [*graph.objects(rdflib.URIRef(said["iri"]), LICENCE)] == [rdflib.URIRef(CC_BY)]
    page = requests.get(process.url, headers={"Accept": "text/html"}, timeout=120).text
    assert f'<a rel="license" href="{CC_BY}">' in page
    assert process.end() == 0
    assert '<h1 id="title">O&#x27;Neill&#x27;s &quot;flat&quot;' in page


def test_check_tells_of_a_history_that_is_missing(flat, capsys):
    assert main(["check", str(flat)]) == 0
    assert "keeps no history" not in capsys.readouterr().err
    for file in flat.glob("history.sqlite*"):
        file.unlink()
    assert main(["check", str(flat)]) == 0
    assert "keeps no history here" in capsys.readouterr().err


def test_a_map_in_place_of_a_recording_is_told(flat: Path, fails: Callable[..., str]) -> None:
    for words in (("info", flat), ("map", flat, "--into", flat.parent / "other.map")):
        assert f"is a map; `hereabouts describe {flat}` shows it" in fails(*words)


def test_commands_in_hints_name_the_map(flat: Path, fails: Callable[..., str]) -> None:
    assert f"`hereabouts ask {flat} objects`" in fails("log", flat, "object/9")
    spaced = flat.rename(flat.with_name("my flat.map"))
    assert f"`hereabouts ask '{spaced}' objects`" in fails("log", spaced, "object/9")
