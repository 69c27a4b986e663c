"""Settings of the reference mapper: each number with symbol, unit and section of the thesis.

Where the thesis' text and its published code disagree the text counts, except for plain misprints;
`docs/explanation/mapping.md` lists each case.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

UnknownLabels = Literal["ignore", "provisional"]

_SHARES: Final = (
    *("purity", "max_unknown_view", "min_score"),
    *("least_scene", "scene_trust", "objects_weight"),
)


@dataclass(frozen=True, slots=True)
class ReferenceSettings:
    """The reference mapper's settings; the defaults are the thesis' own values.

    Raises ValueError where a value cannot work.
    """

    # localisation, section 3.3.1
    max_bins: int = 1000  # ours: a narrow peak in a wide range would need millions
    min_score: float = 0.0  # detections below are ignored; the detector has its own threshold

    # association and confidence, section 3.3.1
    kappa: float = 0.75  # kappa [m]: nearer than this is the same object
    phi: float = 0.8  # phi of eq. 3.1: weight of a detection's score
    nu: float = 3.0  # nu of eq. 3.1: maximum confidence
    xi: float = 0.45  # xi of eq. 3.4: decay for each miss

    # negative evidence, section 3.3.1
    min_depth: float = 0.8  # [m] the sensor's good range, to register and to decrease
    max_depth: float = 4.6  # [m]
    occlusion_window: int = 10  # W of eq. 3.3 [px]: a square of this side

    # places, section 3.3.2
    purity: float = 0.75  # minimum share of a view's points in one place
    max_unknown_view: float = 0.75  # maximum share of a view without depth (author's code)
    history_length: int = 50  # poses remembered for each place
    history_distance: float = (
        0.15  # [m] and history_angle: nearer views are repeats (author's code)
    )
    history_angle: float = 0.17453292519943295  # [rad] 10 degrees
    least_belief: float = 0.005  # ours: minimum belief in the graph, which has steps of 0.01
    stride: int = 4  # [px] sampling step of a view's pixels; the author's code has 3

    # labels that name no category (ours; the thesis' networks have none)
    unknown_labels: UnknownLabels = "ignore"
    least_scene: float = (
        0.1  # minimum probability in a view at which such a label becomes a category
    )

    # place categories inferred from the objects in them (ours)
    places_from_objects: bool = False
    objects_weight: float = 0.5  # share of its log-likelihood that an object counts for
    scene_trust: float = 0.9  # share of the prior that is the views'; the rest is frequencies'
    frequency_weight: float = 0.5  # exponent of the frequencies of rooms that weigh the views

    # scoring against hand-made truth (ours)
    match_distance: float = 0.5  # [m]
    match_distance_large: float = 1.0  # [m]
    large_labels: tuple[str, ...] = ("bed", "couch", "dining table")

    def __post_init__(self) -> None:
        for name in ("kappa", "phi", "nu", "xi", "match_distance", "match_distance_large"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("max_bins", "occlusion_window", "history_length", "stride"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name in _SHARES:
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie in 0..1, got {getattr(self, name)}")
        if not 0 < self.min_depth < self.max_depth:
            raise ValueError(f"depth range {self.min_depth}..{self.max_depth} m is empty")
        if self.unknown_labels not in get_args(UnknownLabels):
            choices = " or ".join(get_args(UnknownLabels))
            raise ValueError(f"unknown_labels must be {choices}, got {self.unknown_labels!r}")
