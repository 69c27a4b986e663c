"""Hooks of `mkdocs build`: the shelves of docs/index.md, and pages of files beside docs/."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
#: files of the repository that are pages of the site, too
PROJECT = {
    "README.md": "project/readme.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "CHANGELOG.md": "project/changelog.md",
    "SECURITY.md": "project/security.md",
    "NOTICE": "project/notice.md",
    "CITATION.cff": "project/citation.md",
}
#: what the theme takes from elsewhere for a search that works from a file, and the copy of it
SHIM = "https://unpkg.com/iframe-worker/shim", "assets/iframe-worker.js"
_LINK = re.compile(r"\[(?P<title>[^\]]*)\]\((?P<path>[^)#:\s]+)(?P<anchor>#[^)\s]*)?\)")


def on_config(config: Any) -> Any:
    """Navigation: the tutorial, then the shelves in the order of the index."""
    sections = re.split(r"^## ", (ROOT / "docs/index.md").read_text("utf-8"), flags=re.MULTILINE)
    nav: list[Any] = [{"Overview": "index.md"}, {"Tutorial": _pages(sections[0])}]
    nav += [{text.partition("\n")[0].strip(): _pages(text)} for text in sections[1:]]
    config.nav = [*nav, {"Project": list(PROJECT.values())}]
    return config


def _pages(section: str) -> list[str]:
    paths = [match["path"] for match in _LINK.finditer(section)]
    return list(dict.fromkeys(p for p in paths if p.endswith(".md") and not p.startswith("..")))


def on_files(files: Files, config: Any) -> Files:
    """Add the pages of files that lie beside docs/."""
    for name, page in PROJECT.items():
        text = (ROOT / name).read_text("utf-8")
        if not name.endswith(".md"):
            text = f"# {name}\n\n```text\n{text}\n```\n"
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links between docs/ and the files beside it lead to their pages; other files are named."""
    source = page.file.src_uri
    beside = {uri: name for name, uri in PROJECT.items()}
    folder = ROOT if source in beside else (ROOT / "docs" / source).parent

    def follow(match: re.Match[str]) -> str:
        target = (folder / match["path"]).resolve()
        if not target.is_relative_to(ROOT):
            return match[0]
        inside = target.relative_to(ROOT).as_posix()
        if inside not in PROJECT and not inside.startswith("docs/"):
            return f"{match['title']} (`{inside}`)"
        uri = PROJECT.get(inside, inside.removeprefix("docs/"))
        up = "../" * source.count("/")
        return f"[{match['title']}]({up}{uri}{match['anchor'] or ''})"

    return _LINK.sub(follow, markdown) if source in beside or "](../" in markdown else markdown


def on_post_template(output: str, **_: Any) -> str:
    """As of pages: of the page for what is not found, at the root of the site."""
    return output.replace(*SHIM)


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Nothing is loaded from elsewhere."""
    elsewhere, copy = SHIM
    return output.replace(elsewhere, "../" * page.url.count("/") + copy)
