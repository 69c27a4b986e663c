"""Networks in the wild: detectors as other programs export them, read without options.

    python -m benchmarks.networks_in_the_wild PICTURE [--kind WORD ...]

Each network is made here. It looks for a patch of one colour in its input, which needs the order of
axes and the values of its exporter, and answers in its exporter's form that a cup is there, among
weak boxes of other things. The patch is painted into PICTURE, as it is and turned upright. A kind
is right where label, box and score are. One that is refused is tried with the option that the line
names. Prints Markdown; exit code 1 where a network is silently wrong, or a line names no way.
"""

from __future__ import annotations

import argparse
import logging
import re
import sys
import tempfile
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.networks_in_the_wild.kinds import KINDS, Kind
from benchmarks.networks_in_the_wild.looking import SCORE, patched, seen_at, write
from kg.model.errors import ModelError
from lab.command_line import parser_of, run
from perception.inference.detector import load_detector
from perception.sources.folders.image_files import read_colour

NEAR: Final = 3.0  # [px] of the picture
NEAR_SCORE: Final = 0.02
WAYS: Final = r"export|metadata|known:|labels"  # in a line that refuses


def difference(kind: Kind, rgb: NDArray[np.uint8], folder: Path, head: str | None = None) -> str:
    """What is wrong with what a network of this kind finds in a picture; "" where nothing is."""
    painted, box = patched(rgb)
    path = folder / "exported.onnx"
    write(kind, seen_at(kind, painted, box), path)
    found = load_detector(path, head=head).detect_image(painted)
    if found.label != ("cup",):
        return ", ".join(found.label[:3]) or "nothing found"
    off = float(np.abs(found.xyxy[0] - box).max())
    if off > NEAR:
        return f"a box {off:.0f} px off"
    return "" if abs(found.score[0] - SCORE) < NEAR_SCORE else f"score {found.score[0]:.2f}"


def verdict(kind: Kind, pictures: list[NDArray[np.uint8]], folder: Path) -> tuple[str, str]:
    """What becomes of a kind, and the line that was said."""
    said = _Lines()
    logging.getLogger().addHandler(said)
    try:
        wrong = [one for rgb in pictures if (one := difference(kind, rgb, folder))]
    except ModelError as error:
        return _refused(kind, pictures, folder, str(error)), str(error)
    finally:
        logging.getLogger().removeHandler(said)
    line = said.lines[0] if said.lines else ""
    if not wrong:
        return "right, with a line" if line else "right", line
    return f"{'told' if line else 'SILENTLY WRONG'}: {wrong[0]}", line


def _refused(kind: Kind, pictures: list[NDArray[np.uint8]], folder: Path, line: str) -> str:
    for head in re.findall(r"--head (\S+)", line):
        try:
            if not any(difference(kind, rgb, folder, head) for rgb in pictures):
                return f"refused, works with --head {head}"
        except ModelError:
            continue
    if "--head" in line:
        return "OPTION FAILS"
    return "refused, to be exported in another way" if re.search(WAYS, line) else "REFUSED"


class _Lines(logging.Handler):
    """Warnings."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines = list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


def compare(arguments: argparse.Namespace) -> int:
    """Print the table."""
    words = [word.lower() for word in arguments.kind]
    rgb = read_colour(arguments.picture)
    pictures = [rgb, np.ascontiguousarray(np.rot90(rgb))]
    outcomes = list[str]()
    sys.stdout.write("| exported by | result |\n|---|---|\n")
    with tempfile.TemporaryDirectory() as folder:
        for name, (answer, options) in KINDS.items():
            if words and not any(word in name.lower() for word in words):
                continue
            outcome, line = verdict(Kind(answer=answer, **options), pictures, Path(folder))
            outcomes.append(outcome)
            sys.stdout.write(f"| {name} | {outcome} |\n")
            if arguments.lines and line:
                sys.stderr.write(f"    {line}\n")
    right = sum(one == "right" for one in outcomes)
    good = sum(one.startswith(("right", "refused, ", "told: ")) for one in outcomes)
    sys.stdout.write(f"\n{right} of {len(outcomes)} right without a line, {good} good\n")
    return 0 if good == len(outcomes) else 1


def main() -> int:
    """Parse the command line."""
    parser = parser_of("benchmarks.networks_in_the_wild", __doc__)
    parser.add_argument("picture", type=Path, help="a photograph")
    parser.add_argument("--kind", action="append", default=[], help="words of names (again)")
    parser.add_argument("--lines", action="store_true", help="print what was said")
    return run(parser, compare)


if __name__ == "__main__":
    sys.exit(main())
