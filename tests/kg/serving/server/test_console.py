"""The console: a page that asks a map in SPARQL, in a real browser, and what it asks the server."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import pytest

from kg.serving.server.linked_data.descriptions import local_path
from tests.kg.serving.server.browser_pages import HOSTILE, PATIENCE, OpenPage, faults, says
from tests.kg.serving.server.conftest import READER
from tests.waiting import until

if TYPE_CHECKING:
    from conftest import Served

CUPS = "SELECT ?cup ?name { ?cup a here:Cup ; rdfs:label ?name }"


def write(page: Any, query: str) -> None:
    """Replace the query in the editor, as somebody types it."""
    page.click(".cm-content")
    page.keyboard.press("Control+a")
    page.keyboard.insert_text(query)


def ask(page: Any, query: str) -> None:
    write(page, query)
    page.keyboard.press("Control+Enter")


def test_pages_run_no_script_and_no_style_of_their_own_text(shown: Served) -> None:
    for path in ("", "console", "object/1"):
        page = shown.get(path, headers={"Accept": "text/html"})
        policy = page.headers["Content-Security-Policy"]
        assert "default-src 'none'; script-src 'self'; style-src 'self'" in policy
        assert "unsafe" not in policy
        assert "<style" not in page.text
        assert "://" not in "".join(re.findall(r"<(?:script|link)[^>]*>", page.text))


def test_questions_are_listed_with_their_parameters(shown: Served) -> None:
    content = shown.get("queries").json()
    assert content["prefixes"]["here"] == "https://w3id.org/hereabouts#"
    (question,) = (q for q in content["queries"] if q["name"] == "objects-by-category")
    assert question["columns"][0] == "object"
    category, least = question["parameters"]
    assert [category[key] for key in ("name", "type", "default")] == ["category", "category", None]
    assert (least["name"], least["default"]) == ("least", "0.5")


def test_a_question_is_given_as_sparql_with_its_values(shown: Served) -> None:
    answer = shown.get("queries/objects-by-category", params={"category": "cup"})
    assert answer.headers["Content-Type"].startswith("application/sparql-query")
    assert [row["label"] for row in shown.rows(answer.text)] == ["cup 1"]


@pytest.mark.parametrize(
    ("path", "status", "word"),
    [
        ("queries/objects-by-category?category=cpu", 422, "did you mean"),
        ("queries/objects-by-category", 400, "category"),
        ("queries/objects-by-category?category=cup&category=bowl", 400, "2 times"),
        ("queries/objects-by-category?category=cup&least=x", 400, "number"),
        ("queries/objects-by-category?category=cup&most=1", 400, "most"),
        ("queries/objects-by-categories?category=cup", 404, "did you mean"),
    ],
)
def test_values_that_do_not_fit_are_refused_in_words(shown, path, status, word):
    answer = shown.get(path)
    assert (answer.status_code, word in answer.text) == (status, True)


def test_a_shipped_question_is_asked_and_shown_on_the_map(open_page: OpenPage) -> None:
    page = open_page("console")
    page.click("#questions >> text=objects-by-category")
    page.fill("#question [name=category]", "cup")
    page.click("#question >> text=Ask")
    says(page, "#table", "cup 1")
    assert page.get_attribute("#table a", "href") == "/object/1"
    page.click("text=on the map")
    says(page, "#status", "1 of the answer on the map")
    assert page.locator("#canvas").bounding_box()["height"] > 200
    assert page.is_visible("#table")
    page.click("#on-map")
    assert not page.is_visible("#canvas")


def test_the_editor_completes_words_and_marks_errors_at_their_place(open_page: OpenPage) -> None:
    page = open_page("console")
    for typed, offered in (
        ("SELECT ?thing { ?thing here:existe", "here:existence"),
        ("SELECT ?thing { ?thing a here:Cu", "here:Cup"),
        ("SELECT ?thing { ?th", "?thing"),
        ("whereab", "whereabouts"),
    ):
        write(page, "")
        page.keyboard.type(typed)
        says(page, ".cm-tooltip-autocomplete", offered)
        page.keyboard.press("Escape")
    ask(page, "SELECT ?x\n{ ?x a here:Cup }}")
    says(page, "#status", "line 2, column 1")
    says(page, ".cm-line:nth-child(2) .cm-lintRange-error", "}")
    ask(page, CUPS)
    says(page, "#table", "cup 1")
    assert page.locator(".cm-lintRange-error").count() == 0


def test_names_and_iris_of_others_are_text_and_no_links_elsewhere(own, open_page):
    own.map.assertions.add(f"{own.map.base}object/1", "label", HOSTILE, by="mallory")
    # what others write may come a moment later to a reader
    until(lambda: "onerror" in own.get(f"sparql?query={quote(CUPS)}").text)
    page = open_page("console", own)
    ask(page, CUPS)
    says(page, "#table", HOSTILE)
    page.click("#table th >> text=name")
    says(page, "#before", "SELECT ?cup")
    page.click("#questions >> text=whereabouts")
    ask(page, f'SELECT ("{HOSTILE.replace(chr(34), chr(39))}" AS ?x) {{}}')
    says(page, "#table", "onerror")
    assert page.locator("img").count() == 0
    other = f"{own.map.base}/evil.example/"  # a path of the map that a browser takes for a host
    for iri in ("javascript:alert(1)", other):
        ask(page, f'SELECT (IRI("{iri}") AS ?x) {{}}')
        says(page, "#table a", "alert" if "alert" in iri else "/evil.example/")
        assert page.get_attribute("#table a", "href") == f"/resource?iri={quote(iri, safe='()')}"
    assert local_path(own.map.base, other).startswith("/resource?iri=")


def test_a_click_on_the_name_of_a_column_sorts_by_it(open_page: OpenPage) -> None:
    page = open_page("console")
    rows = '(10 "b") (9 "c") (UNDEF "a") (-2.5 "d")'
    ask(page, f"SELECT ?n ?name {{ VALUES (?n ?name) {{ {rows} }} }}")
    says(page, "#status", "4 rows")
    for clicked, first, sorting in (
        ("n", "-2.5", "ascending"),
        ("n", "10", "descending"),
        ("name", "", "ascending"),
        ("name", "-2.5", "descending"),
    ):
        page.click(f"#table th >> text=/^{clicked}$/")
        assert page.inner_text("#table td >> nth=0") == first
        assert page.get_attribute("#table th[aria-sort]", "aria-sort") == sorting
    assert page.locator("#table td[style*=gradient]").count() == 0  # words have no bars
    page.click("#table th >> text=/^n$/")
    assert page.locator("#table td[style*=gradient]").count() == 3


def test_a_question_in_words_is_answered_with_the_query_behind_it(open_page: OpenPage) -> None:
    page = open_page("console")
    page.fill("#words", "what is in the kitchen?")
    page.press("#words", "Enter")
    says(page, "#said", "2 objects")
    says(page, ".cm-content", "here:inPlace")
    says(page, "#table", "cup 1")
    ask(page, "where is the cup?")  # in the editor, too
    says(page, "#said", "cup 1")
    says(page, ".cm-content", "hereabouts#Cup")
    ask(page, "how far is the cup from the chair?")
    says(page, "#said", "1.4 m")
    says(page, "#status", "no single query")
    ask(page, "please fly to the moon")
    says(page, "#status", "not understood")


def test_a_query_comes_by_its_address_and_from_those_of_before(open_page: OpenPage) -> None:
    page = open_page(f"console#query={quote(CUPS)}")
    says(page, ".cm-content", "here:Cup")
    assert page.locator("#table >> text=cup 1").count() == 0  # it waits
    page.click("#form >> text=Ask")
    says(page, "#table", "cup 1")
    assert quote("here:Cup", safe="") in page.url
    page.click("#questions >> text=graph-sizes")
    says(page, "#before", "graph-sizes")
    page.reload()
    page.wait_for_selector("html[data-ready]")
    page.click("#before >> text=SELECT ?cup")
    says(page, "#table", "cup 1")
    assert page.locator("#before li").all_inner_texts() == [CUPS, "graph-sizes"]


def test_answers_are_downloaded(open_page: OpenPage) -> None:
    page = open_page("console")
    for query, name, file, content in (
        (CUPS, "CSV", "answer.csv", "cup,name"),
        (CUPS, "TSV", "answer.tsv", "?cup\t?name"),
        (CUPS, "JSON", "answer.json", '"bindings"'),
        (f"CONSTRUCT {{ ?cup rdfs:label ?name }} {CUPS[17:]}", "Turtle", "answer.ttl", "cup 1"),
    ):
        ask(page, query)
        with page.expect_download() as coming:
            page.click(f"#downloads >> text={name}")
        assert coming.value.suggested_filename == file
        assert content in coming.value.path().read_text()


def test_the_form_asks_without_scripts(open_page: OpenPage) -> None:
    page = open_page("console", java_script_enabled=False, ready="#query")
    page.fill("#query", "ASK { ?cup a here:Cup }")
    page.click("#form >> text=Ask")
    says(page, "body", "true")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_console_is_accessible_and_fits_on_a_phone(open_page: OpenPage, scheme: str) -> None:
    pytest.importorskip("axe_playwright_python")
    page = open_page("console", color_scheme=scheme, bypass_csp=True)
    page.click("#questions >> text=objects-by-category")
    ask(page, "SELECT ?x ?y { ?o here:x ?x ; here:y ?y }")
    says(page, "#status", "rows,")
    page.click("#table th >> text=x")
    assert faults(page) == []
    page.set_viewport_size({"width": 390, "height": 844})
    ask(page, "SELECT * { GRAPH ?g { ?s ?p ?o } } LIMIT 20")
    says(page, "#status", "20 rows")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


@pytest.mark.parametrize("path", ["", "console"])
def test_a_private_map_is_looked_at_with_a_token_that_is_kept_nowhere(private, open_page, path):
    page = open_page(path, private, ready="#entry")
    page.fill("#entry-token", "a-token-that-somebody-guessed")
    page.click("#entry button")
    says(page, "#entry-outcome", "private")
    page.fill("#entry-token", READER)
    page.click("#entry button")
    page.wait_for_selector("html[data-ready]")
    if path:
        ask(page, CUPS)
        says(page, "#table", "cup 1")
    else:
        says(page, "#count", "2 of 2 objects")
        private.put(1, "cup", 1.0 + private.map.sequence / 10, 0.5)
        says(page, "#sequence", str(private.map.sequence))
    says(page, "h1", "flat <1>")
    kept = page.evaluate(
        "JSON.stringify([location.href, document.cookie, {...localStorage}, {...sessionStorage}])"
    )
    assert READER not in kept
    page.reload()
    page.wait_for_selector("#entry-token", timeout=PATIENCE)


def test_the_vendored_editor_is_what_its_build_file_names() -> None:
    root = Path(__file__).parents[4]
    pinned = json.loads((root / "bundles/codemirror/package.json").read_text())["dependencies"]
    vendored = root / "kg/serving/server/files/vendor"
    banner = (vendored / "codemirror.min.js").read_text().partition("*/")[0]
    licences = (vendored / "codemirror.LICENSES").read_text()
    for name, version in pinned.items():
        assert f"{name} {version}" in banner
        assert f"{name} {version}" in licences
