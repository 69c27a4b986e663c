"""The documentation as a website: no broken link, and nothing is loaded from elsewhere."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.kg.serving.server.browser_pages import ARGUMENTS, CHROMIUM

pytest.importorskip("material", reason="pip install 'hereabouts[docs]'")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the site, built as `mkdocs build --strict` does."""
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


class Loaded(HTMLParser):
    """What a page loads by itself."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in ("script", "img", "iframe"):
            self.addresses.append(given.get("src") or "")
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload"):
            self.addresses.append(given.get("href") or "")


def test_pages_load_what_is_in_the_site_and_nothing_else(site: Path) -> None:
    pages = [page for page in site.rglob("*.html") if page.name != "404.html"]
    assert len(pages) > 50
    for page in pages:
        for address in filter(None, Loaded(page).addresses):
            path = address.partition("?")[0].partition("#")[0]
            assert (page.parent / path).exists(), f"{page.relative_to(site)}: {address}"


def test_styles_and_scripts_name_no_other_host(site: Path) -> None:
    for style in site.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(https?:)?//", style.read_text(encoding="utf-8"))
    for page in site.rglob("*.html"):
        assert "unpkg.com" not in page.read_text(encoding="utf-8")


def test_every_page_of_the_shelves_is_in_the_navigation(site: Path) -> None:
    index = (site / "index.html").read_text(encoding="utf-8")
    shelves = ("tutorial", "how-to", "reference", "explanation")
    pages = [p for shelf in shelves for p in (ROOT / "docs" / shelf).glob("*.md")]
    assert [p for p in pages if f'href="{p.parent.name}/{p.stem}.html"' not in index] == []
    assert 'href="project/contributing.html"' in index


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium")
@pytest.mark.parametrize(("width", "scheme"), [(1300, "light"), (390, "dark")])
def test_the_site_and_its_search_work_from_a_file(site: Path, width: int, scheme: str) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    faults, requests = list[str](), list[str]()
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        size = {"width": width, "height": 844}
        page = browser.new_page(viewport=size, color_scheme=scheme)
        page.on("console", lambda message: faults.append(message.text))
        page.on("request", lambda request: requests.append(request.url))
        page.goto((site / "explanation" / "mapping.html").as_uri())
        page.wait_for_selector("[data-md-component=search]", state="attached")
        page.keyboard.press("f")  # the theme's key for its search
        page.wait_for_selector(".md-search__input:focus", timeout=60_000)
        page.keyboard.type("identity switches")
        # the results come one after the other
        result = ".md-search-result__link[href*='evaluate.html']"
        page.wait_for_selector(result, state="attached", timeout=60_000)
        # nothing is wider than the window once the search has slid in
        page.wait_for_function(f"document.documentElement.scrollWidth === {width}", timeout=60_000)
        colours = page.evaluate("document.body.dataset.mdColorScheme")
        browser.close()
    assert faults == []
    assert [url for url in requests if not url.startswith("file:")] == []
    assert colours == ("default" if scheme == "light" else "slate")
