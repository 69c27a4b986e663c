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
#: what distributions that say too little say in their repositories
KNOWN = {
    "apsw": "zlib licence or any OSI licence",
    "axe-playwright-python": "MIT",
    "owlrl": "W3C software licence",
    "pycocotools": "BSD-2-Clause",
}


def closure(name: str, extras: set[str]) -> dict[str, metadata.Distribution]:
    """The distributions that one needs, by name, as far as they are installed."""
    found: dict[str, metadata.Distribution] = {}
    asked = [(name, extras)]
    while asked:
        name, extras = asked.pop()
        key = canonicalize_name(name)
        try:
            one = found.setdefault(key, metadata.distribution(name))
        except metadata.PackageNotFoundError:
            continue  # of an extra that is not installed
        for text in one.requires or ():
            need = Requirement(text)
            scopes = [{"extra": extra} for extra in extras or {""}]
            wanted = need.marker is None or any(need.marker.evaluate(scope) for scope in scopes)
            if wanted and (canonicalize_name(need.name) not in found or need.extras):
                if canonicalize_name(need.name) == key and need.extras <= extras:
                    continue
                asked.append((need.name, set(need.extras)))
    return found


def licence(one: metadata.Distribution) -> str:
    """What a distribution says of its licence: expression, classifiers, or the first line."""
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
