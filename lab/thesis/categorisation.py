"""Table 4.4: the category of a place by the Bayes filter and by the mean, with and without prior.

A category counts from a belief of 15 % on (section 4.3), as the first or among the first five. The
metric of the thesis' own final beliefs (Table 6.2) is computed; its pictures are not at hand, so
the filters run on photographs: each folder's photographs are the views of one place, though each
shows another room.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from kg.model.errors import RecordingError
from kg.serving.opening import in_memory_map
from lab.thesis.scenarios import DATA, rows_of
from mapping.labels.label_resolver import LabelResolver
from mapping.reference.belief_filters import mean_update
from perception.inference.scene_classifier import load_scene_classifier
from perception.sources.folders.image_files import read_colour

Belief = Mapping[str, float]

#: section 4.3: the indoor categories that the system is expected to meet ("prior knowledge")
INDOOR_CATEGORIES: Final = (
    *("attic", "auditorium", "bar", "bedroom", "classroom", "corridor", "dining room", "dinette"),
    *("home office", "kitchen", "living room", "lobby", "office", "pantry", "parking lot"),
    *("parlor", "patio", "pavilion", "staircase", "veranda", "waiting room"),
)
FLOOR: Final = 1e-3  # ours: minimum likelihood, so that no zero rules a category out
MIN_BELIEF: Final = 0.15  # belief from which a category counts
FILTERS: Final = {
    "bayes": "Bayes",
    "bayes_prior": "Bayes, prior",
    "mean": "mean",
    "mean_prior": "mean, prior",
}
PUBLISHED: Final = {  # Table 4.4: top-1 and top-5 [%]
    "bayes": (44.44, 44.44),
    "bayes_prior": (66.67, 66.67),
    "mean": (77.78, 88.89),
    "mean_prior": (77.78, 88.89),
}
VIEWS: Final = 12  # of each place
DRAWS: Final = 50  # of the views, in another order


def bayes_update(
    belief: Mapping[str, float],
    scores: Mapping[str, float],
    categories: Collection[str],
    floor: float,
) -> dict[str, float]:
    """Discrete Bayes filter: the normalised product of prior belief and network likelihood.

    After reference [2] of the thesis (Suenderhauf et al., 2016), with a place that stays what it
    is. The prior of a place never viewed is uniform over `categories`. Prior and likelihood are
    at least `floor`, so that no single view rules a category out for good.
    """
    product = {
        category: max(belief.get(category, 0.0) if belief else 1.0, floor)
        * max(scores.get(category, 0.0), floor)
        for category in categories
    }
    total = sum(product.values())
    return {category: value / total for category, value in sorted(product.items())}


def with_prior(scores: Mapping[str, float], allowed: Collection[str]) -> dict[str, float] | None:
    """Prior knowledge (section 4.3): scores outside `allowed` set to 0, the rest renormalised.

    None where nothing is left: such a view carries no information.
    """
    kept = {category: value for category, value in scores.items() if category in allowed}
    total = sum(kept.values())
    return {category: value / total for category, value in kept.items()} if total > 0 else None


def ranked(belief: Belief, first: int) -> set[str]:
    """Of the `first` most believed categories, those believed to at least 15 %."""
    best = sorted(belief, key=lambda category: (-belief[category], category))[:first]
    return {category for category in best if belief[category] >= MIN_BELIEF}


def accuracy(places: Iterable[tuple[str, Belief]], first: int) -> float:
    """Share [%] of places, (true category, belief) each, whose category is in `ranked`."""
    right = [truth in ranked(belief, first) for truth, belief in places]
    return 100 * sum(right) / len(right)


def printed_beliefs(name: str) -> list[tuple[str, Belief]]:
    """True category and final belief of each place by one of `FILTERS`, as Table 6.2 prints it."""
    found: list[tuple[str, Belief]] = []
    for row in rows_of("table_6_2.csv", DATA):
        pairs = (cell.strip().rsplit(" ", 1) for cell in row[name].split(";"))
        found.append((row["label"], {label: float(p) / 100 for label, p in pairs}))
    return found


def scenes_of(folders: Sequence[Path], network: str) -> dict[str, list[dict[str, float]]]:
    """Scene scores by category IRI of each photograph, by the IRI of its folder's category.

    `folders` hold a folder for each category, named as the ontology calls it. Raises RecordingError
    where there are none, ModelError for what is no scene classifier.
    """
    classifier = load_scene_classifier(network)
    with in_memory_map(title="Table 4.4") as semantic_map:
        labels = LabelResolver(semantic_map, "place")
        found: dict[str, list[dict[str, float]]] = {}
        for folder in sorted(one for parent in folders for one in parent.glob("*/")):
            category = labels.category(folder.name)
            for path in sorted(folder.glob("*.jpg")) if category else ():
                scores: dict[str, float] = {}
                for label, p in classifier.classify_image(read_colour(path)).probability.items():
                    if (iri := labels.category(label)) is not None:
                        scores[iri] = scores.get(iri, 0.0) + p
                found.setdefault(str(category), []).append(scores)
    if not found:
        raise RecordingError(
            f"no photographs in {', '.join(map(str, folders))}; DIR/kitchen/*.jpg would work"
        )
    return found


def filtered(
    scenes: Mapping[str, Sequence[Belief]], seed: int
) -> dict[str, list[tuple[str, Belief]]]:
    """True category and final belief of each place, by filter, after a draw of its views."""
    rng = np.random.default_rng(seed)
    every, indoor = _categories()
    found: dict[str, list[tuple[str, Belief]]] = {name: [] for name in FILTERS}
    for truth, views in scenes.items():
        drawn = [views[k] for k in rng.permutation(len(views))[:VIEWS]]
        for name in FILTERS:
            known = indoor if name.endswith("_prior") else every
            belief: dict[str, float] = {}
            used = (with_prior(v, known) if known is indoor else v for v in drawn)
            for number, scores in enumerate(s for s in used if s is not None):
                if name.startswith("bayes"):
                    belief = bayes_update(belief, scores, known, FLOOR)
                else:
                    belief = mean_update(belief, number, scores)
            found[name].append((truth, belief))
    return found


@cache
def _categories() -> tuple[list[str], list[str]]:
    """IRIs of all place categories, and of those of the thesis' prior knowledge."""
    with in_memory_map(title="Table 4.4") as semantic_map:
        catalogue = semantic_map.catalogue
        every = [one.iri for one in catalogue.categories if one.kind == "place"]
        return every, [catalogue.find(name, "place").iri for name in INDOOR_CATEGORIES]


def report(folders: Sequence[Path], network: str) -> Iterator[str]:
    """Lines of Markdown: published, recomputed from Table 6.2, and on photographs."""
    yield f"| | {' | '.join(FILTERS.values())} |"
    yield "|---|" + "---|" * len(FILTERS)
    for row, first in enumerate((1, 5)):
        cells = (f"{PUBLISHED[name][row]:.1f}" for name in FILTERS)
        yield f"| top-{first} [%], published | {' | '.join(cells)} |"
    for first in (1, 5):
        cells = (f"{accuracy(printed_beliefs(name), first):.1f}" for name in FILTERS)
        yield f"| top-{first} [%], from Table 6.2 | {' | '.join(cells)} |"
    if not folders:
        return
    scenes = scenes_of(folders, network)
    places: dict[str, list[tuple[str, Belief]]] = {name: [] for name in FILTERS}
    for seed in range(DRAWS):
        for name, drawn in filtered(scenes, seed).items():
            places[name] += drawn
    for first in (1, 5):
        cells = (f"{accuracy(places[name], first):.1f}" for name in FILTERS)
        yield f"| top-{first} [%], photographs of {len(scenes)} places | {' | '.join(cells)} |"
