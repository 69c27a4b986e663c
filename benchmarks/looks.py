"""Looks of things: found by a word, and known again in the second half of a recording.

python -m benchmarks.looks [ROOM ...]

Words are judged on the boxes of photographs (COCO val2017), and on the boxes of the bundled
detectors in recordings with a complete truth. Known things are judged on the recordings, cut in
two: ten things of the first half are named, drawn 60 times, and all things of the second half are
compared with them, one thing a name.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.rooms.recordings import TRUTH, room_folders, shared_data
from kg.maps.object_pictures import MAX_BYTES
from lab.maps.complete_truth import TrueObject, load_complete_truth
from mapping.frames.projection import to_map
from mapping.looks.known_things import MIN_DISTINCT, MIN_LIKENESS
from mapping.looks.object_looks import Looks, likeness
from mapping.looks.word_looks import MIN_RATIO, imagenet_classes, ratio
from perception.annotate import object_picture
from perception.frames import Frame
from perception.inference.detector import load_detector
from perception.inference.model_zoo import bundled_pair
from perception.sources.recording import open_recording

MIN_SIDE: Final = 20  # [px] of a box in a photograph
NEAR: Final = 0.45  # [m] from a true thing to the middle of its box
VIEWS: Final = 4  # the best of each thing
SEEN: Final = 90  # about as many frames of a recording are looked at
THINGS: Final = 25  # that a word is searched among
DRAWS: Final = 60  # of ten named things
NOBODY: Final = np.zeros((0, 4), np.float32)

View = tuple[int, float, bytes]  # number of the frame, score, picture


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help="redkitchen, ... (default: all)")
    rooms = parser.parse_args().rooms or list(room_folders())
    synsets = _synsets()
    photographs = [(label, Looks.of_pictures([data])) for label, data in _photographs()]
    _words("photographs", photographs, synsets)
    for room in rooms:
        folder = room_folders()[room]
        truth = load_complete_truth(folder / TRUTH)
        views = _views(folder, truth)
        best = {n: _looks(found) for n, found in views.items()}
        _words(room, [(truth[n].label, look) for n, look in best.items()], synsets)
        _known(room, views)


def _synsets() -> dict[str, str]:
    """Label of a category -> the first synset with classes of ImageNet that means the same."""
    found: dict[str, str] = {}
    with (shared_data() / "bundled/words/words.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["relation"] == "same" and row["synset"] in imagenet_classes():
                for label in row["category"].split("|"):
                    found.setdefault(label, row["synset"])
    return found


def _photographs() -> Iterator[tuple[str, bytes]]:
    """Labels and pictures of the boxes of photographs, without people."""
    for name in ("coco", "coco_val64"):
        folder = shared_data() / "data/images" / name
        content = json.loads((folder / "instances.json").read_text(encoding="utf-8"))
        labels = {one["id"]: one["name"] for one in content["categories"]}
        files = {one["id"]: one["file_name"] for one in content["images"]}
        for one in content["annotations"]:
            x, y, width, height = one["bbox"]
            label = labels[one["category_id"]]
            if label == "person" or min(width, height) < MIN_SIDE or one.get("iscrowd"):
                continue
            bgr = cv2.imread(str(folder / "images" / files[one["image_id"]]))
            data = _picture(bgr[:, :, ::-1], (x, y, x + width, y + height))
            if data is not None:
                yield label, data


def _views(folder: Path, truth: tuple[TrueObject, ...]) -> dict[int, list[View]]:
    """Number of a true thing -> its views by the bundled detectors."""
    recording = open_recording(folder)
    p_map = to_map(recording.T_map_world, np.array([one.p_world for one in truth]))
    detectors = [load_detector(name, threshold=0.25, threads=1) for name in bundled_pair()]
    found: dict[int, list[View]] = {}
    for number, frame in enumerate(recording.frames()):
        if number % max(len(recording) // SEEN, 1):
            continue
        for detections in (detector.detect(frame) for detector in detectors):
            rows = zip(detections.xyxy, detections.score, detections.label, strict=True)
            for box, score, label in rows:
                distance = np.linalg.norm(p_map - _middle(frame, box), axis=1)
                fits = [one.accepts(label) for one in truth]
                distance = np.where(fits & (distance < NEAR), distance, np.inf)
                data = _picture(frame.rgb, box.tolist())
                if np.isfinite(distance).any() and data is not None:
                    view = number, float(score), data
                    found.setdefault(int(distance.argmin()), []).append(view)
    return dict(sorted(found.items()))


def _middle(frame: Frame, box: NDArray[np.float32]) -> NDArray[np.float64]:
    """(3,) [m] where the middle of a box lies in the map; nan without depth."""
    (x, y), (width, height) = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
    rows = slice(max(int(y - height / 4), 0), int(y + height / 4) + 1)
    depth = frame.depth[rows, max(int(x - width / 4), 0) : int(x + width / 4) + 1]
    depth = depth[depth > 0]
    if len(depth) < 5:
        return np.full(3, np.nan)
    p_cam = np.linalg.solve(frame.K, np.array([x, y, 1.0])) * np.percentile(depth, 30)
    return frame.T_map_cam[:3, :3] @ p_cam + frame.T_map_cam[:3, 3]


def _picture(rgb: NDArray[np.uint8], box: tuple[float, float, float, float]) -> bytes | None:
    return object_picture(np.ascontiguousarray(rgb), tuple(box), NOBODY, MAX_BYTES)


def _looks(views: list[View]) -> Looks:
    """Looks of the best views, one a frame."""
    by_frame: dict[int, View] = {}
    for view in sorted(views, key=lambda one: -one[1]):
        by_frame.setdefault(view[0], view)
    return Looks.of_pictures(data for _, _, data in list(by_frame.values())[:VIEWS])


def _words(title: str, things: list[tuple[str, Looks]], synsets: Mapping[str, str]) -> None:
    """Print how well things are found by words."""
    labels = np.array([label for label, _ in things])
    ratios = {
        word: np.array([ratio(look, imagenet_classes()[synset]) for _, look in things])
        for word, synset in synsets.items()
    }
    random, ranks, highest = np.random.default_rng(0), [], []
    for word, found in ratios.items():
        others = np.flatnonzero(labels != word)
        for _ in range(100):
            drawn = random.choice(others, min(THINGS, len(others)), replace=False)
            highest.append(found[drawn].max())
        for own in found[labels == word]:
            drawn = random.choice(others, min(THINGS - 1, len(others)), replace=False)
            ranks.append(1 / (1 + (found[drawn] > own).sum()))
    present = [word for word in ratios if word in labels]
    found_share = np.mean([(ratios[w][labels == w] >= MIN_RATIO).mean() for w in present])
    false_share = np.mean(np.array(highest) >= MIN_RATIO)
    print(  # noqa: T201
        f"{title}: {len(things)} things; mean reciprocal rank {np.mean(ranks):.2f}; "
        f"at {MIN_RATIO:g}: found {found_share:.2f}, false words {false_share:.2f}; "
        f"1 false word in 10 at {np.quantile(highest, 0.9):.1f}"
    )


def _known(title: str, views: dict[int, list[View]]) -> None:
    """Print how well things of the first half are known again in the second."""
    middle = np.median([number for found in views.values() for number, _, _ in found])
    first = {n: [one for one in found if one[0] < middle] for n, found in views.items()}
    second = {n: [one for one in found if one[0] >= middle] for n, found in views.items()}
    before = {n: _looks(found).features for n, found in first.items() if found}
    after = {n: _looks(found).features for n, found in second.items() if found}
    both = [n for n in before if n in after]
    if len(both) < 2:
        return
    alike = {(a, b): likeness(before[a], after[b]) for a in before for b in after}
    score = {(a, b): _distinct(alike, a, b) for a in both for b in after}
    for least in (MIN_DISTINCT - 0.06, MIN_DISTINCT, MIN_DISTINCT + 0.06):
        random = np.random.default_rng(1)
        counts = np.zeros(5)  # of known things, named, right; of unknown things, named
        for _ in range(DRAWS):
            named = random.choice(both, min(10, len(both)), replace=False).tolist()
            pairs = [(a, b) for a in named for b in after if score[a, b] >= least]
            name, used = dict[int, int](), set[int]()
            for a, b in sorted(pairs, key=lambda pair: -score[pair]):  # one thing has a name
                if a not in used and b not in name:
                    name[b] = a
                    used.add(a)
            for thing in after:
                is_named, is_known = thing in name, thing in named
                is_right, is_false = name.get(thing) == thing, is_named and not is_known
                counts += (is_known, is_named, is_right, not is_known, is_false)
        known, all_named, right, unknown, false = counts
        print(  # noqa: T201
            f"{title}: known again at {least:.2f}: recall {right / known:.2f}, precision "
            f"{right / max(all_named, 1):.2f}, unknown things named {false / max(unknown, 1):.2f} "
            f"({len(both)} things in both halves)"
        )


def _distinct(alike: Mapping[tuple[int, int], float], a: int, b: int) -> float:
    """Likeness and distinction of `b` as the known thing `a`; below 0 where it is not like it."""
    rival = max((value for (c, d), value in alike.items() if d == b and c != a), default=None)
    found = alike[a, b]
    return -1.0 if found < MIN_LIKENESS else 2 * found - (found if rival is None else rival)


if __name__ == "__main__":
    main()
