"""Licences of what an install brings; exits with 1 where one is unknown or not accepted.

    python .ci/licences.py [EXTRA ...]    a line for each distribution: name, version, licence
    python .ci/licences.py --pins test > .ci/constraints.txt    the versions that were tried

`pip install -c .ci/constraints.txt .` makes the environment that was tried.
"""

from __future__ import annotations

import re
import sys
from importlib import metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ACCEPTED = re.compile(
    r"\b(MIT|BSD|Apache|ISC|PSF|Python Software Foundation|MPL|Mozilla|HPND|Zlib|Unlicense|CC0"
    r"|0BSD|LGPL|Lesser General Public|EPL|Eclipse|W3C|Matplotlib|Academic Free)",
    re.IGNORECASE,
)
#: licences in the repositories of distributions whose metadata name none
KNOWN = {
    "apsw": "zlib licence or any OSI licence",
    "axe-playwright-python": "MIT",
    "owlrl": "W3C software licence",
    "pycocotools": "BSD-2-Clause",
}


def closure(name: str, extras: set[str]) -> dict[str, metadata.Distribution]:
    """The distributions that one needs, by name, as far as they are installed."""
    found: dict[str, metadata.Distribution] = {}
    asked, known = [(name, frozenset(extras))], set[tuple[str, frozenset[str]]]()
    while asked:
        name, wanted = asked.pop()
        key = canonicalize_name(name)
        if (key, wanted) in known:
            continue
        known.add((key, wanted))
        try:
            found[key] = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue  # of an extra that is not installed
        for need in map(Requirement, found[key].requires or ()):
            scopes = [{"extra": extra} for extra in wanted or {""}]
            if need.marker is None or any(need.marker.evaluate(scope) for scope in scopes):
                asked.append((need.name, frozenset(need.extras)))
    return found


def licence(one: metadata.Distribution) -> str:
    """Licence of a distribution by its metadata: expression, classifiers, or text."""
    about = one.metadata
    if known := KNOWN.get(canonicalize_name(about["Name"])):
        return known
    classified = [c.split(" :: ")[-1] for c in about.get_all("Classifier", ()) if "License" in c]
    said = about.get("License-Expression") or "; ".join(classified) or about.get("License") or ""
    return " ".join(said.split())[:60] or "unknown"


def main(words: list[str]) -> int:
    """Print the list, or the pins."""
    extras = {word for word in words if word != "--pins"}
    refused = 0
    for key, one in sorted(closure("hereabouts", extras).items()):
        said = licence(one)
        fits = ACCEPTED.search(said) is not None
        refused += not fits
        if "--pins" not in words:
            print(f"{key:32}{one.version:18}{said}{'' if fits else '   NOT ACCEPTED'}")
        elif key != "hereabouts":
            print(f"{key}=={one.version}")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
