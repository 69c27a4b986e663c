"""Pages in a real browser: how tests open them and wait for what they say."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any

PATIENCE = 120_000  # [ms] for what comes at once, on a machine however slow
HOSTILE = '<img src=x onerror="alert(1)">'
CHROMIUM = shutil.which("chromium")
#: arguments of the browser: it draws in software; without the last ones it asks its makers' hosts
ARGUMENTS = (
    *(
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ),  # drawn in software
    *("--no-sandbox", "--no-first-run"),
    *(
        f"--disable-{name}"
        for name in ("background-networking", "component-update", "sync", "quic", "gpu")
    ),
)
OpenPage = Callable[..., Any]


def says(page: Any, selector: str, text: str) -> None:
    """Wait until an element has the text."""
    from playwright.sync_api import expect

    expect(page.locator(selector)).to_contain_text(text, timeout=PATIENCE)


def open_menu(page: Any, name: str) -> None:
    """Open a menu of the map: layers or more."""
    page.click(f"#{name} > summary")


def show_layer(page: Any, name: str, is_shown: bool) -> None:
    """Show or hide a layer of the map; its menu is closed again, and the pointer away."""
    open_menu(page, "layers")
    page.set_checked(f"[data-layer={name}]", is_shown)
    page.keyboard.press("Escape")
    page.mouse.move(1, 1)


def is_fault(message: Any) -> bool:
    """Whether a line of the browser's console is an error; a refusal (4xx) is the server's word."""
    return message.type == "error" and "responded with a status of 4" not in message.text


def faults(page: Any) -> list[tuple[str, list[str]]]:
    """Faults of accessibility that axe finds, with the elements."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [(fault["id"], [node["html"] for node in fault["nodes"]]) for fault in found]
