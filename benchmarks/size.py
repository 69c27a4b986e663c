"""Size of built wheels: lines, modules, packages, functions, bytes.

    python -m benchmarks.size WHEEL [WHEEL ...]

Prints a table with one column a wheel, named by its folder.
"""

from __future__ import annotations

import argparse
import ast
import statistics
import sys
import zipfile
from collections import Counter
from pathlib import Path

LONG = 300  # lines


def sizes(wheel: Path) -> dict[str, str]:
    """Counts of the Python modules in a wheel, by name."""
    with zipfile.ZipFile(wheel) as archive:
        sources = {
            name: archive.read(name).decode() for name in archive.namelist() if name.endswith(".py")
        }
    lines = {name: text.count("\n") for name, text in sources.items()}
    modules = {name: n for name, n in lines.items() if not name.endswith("__init__.py")}
    folders = Counter(name.rpartition("/")[0] for name in modules)
    trees = [ast.parse(text) for text in sources.values()]
    functions = [node for tree in trees for node in ast.walk(tree) if _is_function(node)]
    classes = Counter(
        node.name
        for tree in trees
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    longest, most = max(modules, key=modules.__getitem__), folders.most_common(1)[0]
    return {
        "lines of Python": f"{sum(lines.values()):,}",
        "modules": f"{len(modules)}",
        "packages": f"{len({name.rpartition('/')[0] for name in sources})}",
        "most modules in one package": f"{most[1]} ({most[0]})",
        "lines of a module, median": f"{statistics.median(modules.values()):.0f}",
        f"modules of more than {LONG} lines": f"{sum(n > LONG for n in modules.values())}",
        "longest module": f"{modules[longest]} ({longest})",
        "functions": f"{len(functions):,}",
        "lines of a function, median": f"{statistics.median(map(_length, functions)):.0f}",
        "public classes that share a name": f"{sum(count > 1 for count in classes.values())}",
        "wheel": f"{wheel.stat().st_size / 1e6:.1f} MB",
    }


def _is_function(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)


def _length(node: ast.AST) -> int:
    return int(node.end_lineno - node.lineno + 1)  # type: ignore[attr-defined]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.size", description=__doc__)
    parser.add_argument("wheels", nargs="+", type=Path, metavar="WHEEL")
    wheels = parser.parse_args().wheels
    found = [sizes(wheel) for wheel in wheels]
    rows = [["", *(wheel.resolve().parent.name for wheel in wheels)], ["---"] * (len(wheels) + 1)]
    rows += [[name, *(one[name] for one in found)] for name in found[0]]
    sys.stdout.write("".join(f"| {' | '.join(row)} |\n" for row in rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
