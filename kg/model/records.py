"""Records of a map: frozen dataclasses, one for each kind of thing, for the other packages.

Metres and radians in the map frame (z up, floor about z = 0), seconds since 1970-01-01 UTC.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import Area, Outline, Rectangle


@dataclass(frozen=True, slots=True)
class Evidence:
    """The observation that explains an object best: the most confident one so far."""

    frame: str  # frame id within the recording
    recording: str  # recording name
    stamp: float  # [s]
    box: tuple[float, float, float, float]  # xyxy [px] in that frame
    score: float  # detector score, 0..1
    model: str  # name of the detector


RelationKind = Literal["on", "inside", "beside"]


@dataclass(frozen=True, slots=True)
class Relation:
    """A spatial relation of an object to another one."""

    kind: RelationKind
    target: str  # IRI of the other object
    probability: float  # 0..1; from 0.5 on it counts as so


@dataclass(frozen=True, slots=True)
class ObjectRecord:
    """An object occurrence as the map believes it now."""

    iri: str
    category: str  # IRI of its class
    p_map: NDArray[np.float64]  # (3,) [m]
    confidence: float  # C of eq. 3.1, 0..nu; not a probability
    existence: float  # 0..1
    observations: int
    first_seen: float  # [s]
    last_seen: float  # [s]
    place: str | None = None  # IRI of the place that contains it
    evidence: Evidence | None = None
    extent: NDArray[np.float64] | None = None  # (3,) [m] of its box along the map's axes
    deviation: float | None = None  # [m] standard deviation of each coordinate of `p_map`
    relations: tuple[Relation, ...] | None = None  # None, when written: the map's stay
    #: what else it may be: category IRI -> probability that a thing of it is there
    labels: Mapping[str, float] = field(default_factory=dict)

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """(3, 3) [m^2] of `p_map`; None where it is not known."""
        return None if self.deviation is None else np.eye(3) * self.deviation**2


@dataclass(frozen=True, slots=True)
class DepartedRecord:
    """An object that left the spot where it stood, as it was known there."""

    iri: str
    category: str  # IRI of its class
    p_map: NDArray[np.float64]  # (3,) [m]
    peak: float  # its greatest existence, 0..1
    observations: int
    first_seen: float  # [s]
    last_seen: float  # [s]
    found_gone: float  # [s] when its spot was first known to be empty
    extent: NDArray[np.float64] | None = None  # (3,) [m] of its box along the map's axes


@dataclass(frozen=True, slots=True)
class PlaceViews:
    """How much of a place, floor and tops of furniture, has been viewed."""

    share: float  # of its area, 0..1
    close_share: float  # of its area, from close by (2 m)
    last: float  # [s] since 1970, to the minute


@dataclass(frozen=True, slots=True)
class PlaceRecord:
    """A place with its area and the belief over its categories.

    Without an `outline` the area is the rectangle; with one, the sides are its bounding rectangle.
    """

    iri: str
    label: str
    xmin: float  # [m]
    xmax: float
    ymin: float
    ymax: float
    views: int = 0  # k of eq. 3.5: scene categorisations that went into the belief
    beliefs: Mapping[str, float] = field(default_factory=dict)  # category IRI -> belief
    #: beliefs by views alone; empty unless there are `evidence_objects`
    scene_beliefs: Mapping[str, float] = field(default_factory=dict)
    evidence_objects: tuple[str, ...] = ()  # IRIs of objects that count in `beliefs`
    outline: Outline = ()  # rings of corners (x, y) [m], the outer one first; () for a rectangle
    from_floor: bool = False  # found in the mapped floor, and changing with it; else it was given
    adjacent: tuple[str, ...] = ()  # IRIs of places that a door leads to
    viewed: PlaceViews | None = None  # None where nothing is known of views

    @property
    def area(self) -> Area:
        """The area of floor that it covers."""
        return Area(self.xmin, self.xmax, self.ymin, self.ymax, outline=self.outline)

    def with_area(self, area: Rectangle) -> PlaceRecord:
        """The same place, covering `area`."""
        return replace(
            self,
            xmin=area.xmin,
            xmax=area.xmax,
            ymin=area.ymin,
            ymax=area.ymax,
            outline=area.outline if isinstance(area, Area) else (),
        )

    @property
    def from_views(self) -> Mapping[str, float]:
        """Beliefs in its categories from the views alone."""
        return self.scene_beliefs if self.evidence_objects else self.beliefs


@dataclass(frozen=True, slots=True)
class DoorRecord:
    """A passage between two places."""

    iri: str  # <base>door/A-B, with the numbers of its places, or <base>door/A-B-2 ...
    x: float  # [m] its middle
    y: float
    width: float  # [m]
    places: tuple[str, str]  # IRIs


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """Where the robot (its camera) is."""

    p_map: NDArray[np.float64]  # (3,) [m]
    heading: float  # [rad] about z, 0 along x
    stamp: float  # [s]


@dataclass(frozen=True, slots=True)
class RecordingRecord:
    """How far a recording has been applied to the map, and how its world sits in the map."""

    name: str
    frames_applied: int
    last_frame: str
    T_map_world: NDArray[np.float64]  # (4, 4)
    scene_model: str = ""  # name of the scene classifier; "" without one


@dataclass(frozen=True, slots=True)
class Assertion:
    """Assertion by a person of one property of an object or place, and the perceived value."""

    subject: str  # IRI of the object or place
    property: str  # "category", "position", "existence", "label", "on" or "inside"
    value: str  # IRI of a category or object; "x y z" [m]; "present"; "absent"; "nothing"; a label
    by: str
    stamp: float  # [s] when it was asserted
    perceived: str | None = None  # like value; of existence a number 0..1; None: no opinion
    strength: float = 0.0  # how strongly perception believes that, 0..1
    since: float | None = None  # [s] since when the two contradict each other; None: they agree
    beliefs: Mapping[str, float] = field(default_factory=dict)  # perception's, of a place


SearchState = Literal["running", "stopped", "found", "given up"]


@dataclass(frozen=True, slots=True)
class SearchRecord:
    """A search by a robot: for what, how far it is, how it ended."""

    iri: str  # <base>search/N
    words: tuple[str, ...]  # the targets as given, e.g. "something to drink from"
    categories: tuple[str, ...]  # IRIs of the categories that are wanted
    state: SearchState
    started: float  # [s]
    ended: float | None = None  # [s] None while it runs
    seconds: float = 0.0  # [s] of the robot's own clock, over all its runs
    left: float = 1.0  # probability that what is still wanted is there to be found
    found: tuple[str, ...] = ()  # IRIs of objects


@dataclass(frozen=True, slots=True)
class LookRecord:
    """A look that a robot took during a search, in vain or not."""

    iri: str  # <search>/look/N
    search: str  # IRI
    number: int  # 1, 2, 3, ... within the search
    stamp: float  # [s]
    position: tuple[float, float]  # [m] where the robot stood
    heading: float  # [rad] the middle of what it saw
    extent: float  # [rad] seen in all, the camera's field of view included
    categories: tuple[str, ...]  # IRIs of the categories it looked for
    found: tuple[str, ...] = ()  # IRIs of the objects of these categories that it showed
    glimpses: tuple[tuple[float, float, float], ...] = ()  # x, y, heading of pictures on the way


@dataclass(frozen=True, slots=True)
class ObstacleRecord:
    """Where a robot on a search could not go on."""

    iri: str  # <search>/obstacle/N
    search: str  # IRI
    number: int
    stamp: float  # [s]
    position: tuple[float, float]  # [m]
    reason: str


#: what is known of a cell of the floor
UNKNOWN: Final = 0  # nobody has seen it
FREE: Final = 1
LOW: Final = 2  # an obstacle that a camera sees over: a table, a bed
TALL: Final = 3  # an obstacle that occludes what is behind it: a wall, a cupboard


@dataclass(frozen=True, slots=True, eq=False)
class FloorTile:
    """A square of the floor of one storey, cell by cell."""

    storey: int  # 0, 1, 2, ...; in the order in which they were met
    column: int  # number of the tile along x, ...
    row: int  # ... and along y
    height: float  # [m] of the floor in the map frame
    resolution: float  # [m] side of a cell
    cells: NDArray[np.uint8]  # (n, n) cells (x, y): UNKNOWN, FREE, LOW or TALL
    changed: float  # [s] stamp of the frame that it was last changed by
    #: (2, m, m) [min since 1970] when each of m x m larger cells was last viewed, from close by and
    #: at all; 0 where never. None where nothing is known of views.
    viewed: NDArray[np.uint32] | None = None

    @property
    def corner(self) -> tuple[float, float]:
        """(x, y) [m] of the corner where both are least."""
        span = len(self.cells) * self.resolution
        return self.column * span, self.row * span


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """One frame's worth of change, applied as one transaction or not at all.

    `objects` and `places` hold the whole new record of everything that may have changed (the writer
    works out which triples differ); `removed` holds IRIs of objects, places and doors that left the
    map, and of departed objects to be forgotten. `departed` says of objects among `removed` that
    they are remembered, and as what.
    """

    objects: tuple[ObjectRecord, ...] = ()
    removed: tuple[str, ...] = ()
    places: tuple[PlaceRecord, ...] = ()
    robot: RobotRecord | None = None
    recording: RecordingRecord | None = None
    search: SearchRecord | None = None
    looks: tuple[LookRecord, ...] = ()
    obstacles: tuple[ObstacleRecord, ...] = ()
    floor: tuple[FloorTile, ...] = ()
    doors: tuple[DoorRecord, ...] = ()
    departed: tuple[DepartedRecord, ...] = ()
