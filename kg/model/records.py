"""Records of a map: frozen dataclasses, one for each kind of thing, for the other packages.

Metres and radians in the map frame (z up, floor about z = 0), seconds since 1970-01-01 UTC.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import Area, Outline, Rectangle, footprint

#: in place of a detector's name: the thing stands out of the mapped surface
SURFACE: Final = "surface"


@dataclass(frozen=True, slots=True)
class Evidence:
    """The best observation of an object: the one with the highest score so far."""

    frame: str  # frame id within the recording
    recording: str  # recording name
    stamp: float  # [s]
    box: tuple[float, float, float, float]  # xyxy [px] in that frame
    score: float  # detector score, 0..1; of SURFACE the share of the thing in view
    model: str  # name of the detector, or SURFACE


RelationKind = Literal["on", "inside", "beside"]


@dataclass(frozen=True, slots=True)
class Relation:
    """A spatial relation of an object to another one."""

    kind: RelationKind
    target: str  # IRI of the other object
    probability: float  # 0..1; from 0.5 on the relation holds


MAX_DEVIATION: Final = 1000.0  # [m] of a position in any map, as ontologies/shapes.ttl has it


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
    extent: NDArray[np.float64] | None = None  # (3,) [m] of its box along its own axes
    deviation: float | None = None  # [m] standard deviation of each coordinate, to MAX_DEVIATION
    relations: tuple[Relation, ...] | None = None  # None: a write keeps the relations in the map
    #: alternative categories: IRI -> probability that an object of that category is there
    labels: Mapping[str, float] = field(default_factory=dict)
    yaw: float = 0.0  # [rad] of its box about z, counterclockwise from the map's axes

    @property
    def footprint(self) -> NDArray[np.float64] | None:
        """(4, 2) [m] corners of its box from above; None without an extent."""
        return None if self.extent is None else footprint(self.p_map, self.extent, self.yaw)

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """(3, 3) [m^2] of `p_map`; None: unknown."""
        return None if self.deviation is None else np.eye(3) * self.deviation**2


@dataclass(frozen=True, slots=True)
class DepartedRecord:
    """An object that left its position, with its last known properties."""

    iri: str
    category: str  # IRI of its class
    p_map: NDArray[np.float64]  # (3,) [m]
    peak: float  # highest existence so far, 0..1
    observations: int
    first_seen: float  # [s]
    last_seen: float  # [s]
    found_gone: float  # [s] when the position was first known to be empty
    extent: NDArray[np.float64] | None = None  # (3,) [m] of its box along its own axes
    yaw: float = 0.0  # [rad] of its box about z, counterclockwise from the map's axes


@dataclass(frozen=True, slots=True)
class PlaceViews:
    """Viewed shares of a place: its floor and the tops of its furniture."""

    share: float  # share of the area, 0..1
    close_share: float  # share of the area viewed from up to 2 m
    last: float  # [s] since 1970, to the minute: the last view


def likeliest(beliefs: Mapping[str, float]) -> str | None:
    """The most believed category, by IRI the last of several alike; None without beliefs."""
    return max(beliefs, key=lambda category: (beliefs[category], category), default=None)


@dataclass(frozen=True, slots=True)
class PlaceRecord:
    """A place with its area and the belief over its categories.

    The sides are the bounding rectangle of the `outline`, or the area itself without an outline.
    """

    iri: str
    label: str
    xmin: float  # [m]
    xmax: float
    ymin: float
    ymax: float
    views: int = 0  # k of eq. 3.5: number of scene categorisations in the belief
    beliefs: Mapping[str, float] = field(default_factory=dict)  # category IRI -> belief
    #: beliefs by views alone; empty unless there are `evidence_objects`
    scene_beliefs: Mapping[str, float] = field(default_factory=dict)
    evidence_objects: tuple[str, ...] = ()  # IRIs of objects that count in `beliefs`
    outline: Outline = ()  # rings of corners (x, y) [m], the outer one first; () for a rectangle
    from_floor: bool = (
        False  # segmented from the mapped floor; False: given by a layout or a person
    )
    adjacent: tuple[str, ...] = ()  # IRIs of places that a door leads to
    viewed: PlaceViews | None = None  # None: unknown

    @property
    def area(self) -> Area:
        """The covered area of the floor."""
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
        """Beliefs in the categories by the views alone."""
        return self.scene_beliefs if self.evidence_objects else self.beliefs


@dataclass(frozen=True, slots=True)
class DoorRecord:
    """A passage between two places."""

    iri: str  # <base>door/A-B, with the numbers of its places, or <base>door/A-B-2 ...
    x: float  # [m] its middle
    y: float
    width: float  # [m]
    places: tuple[str, str]  # IRIs
    marked_by: str = ""  # IRI of the person who marked it; "" if it was found in the floor


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """Pose of the robot: the pose of its camera."""

    p_map: NDArray[np.float64]  # (3,) [m]
    heading: float  # [rad] about z, 0 along x
    stamp: float  # [s]


@dataclass(frozen=True, slots=True)
class RecordingRecord:
    """Progress of mapping a recording, and the transform of its world into the map."""

    name: str
    frames_applied: int
    last_frame: str
    T_map_world: NDArray[np.float64]  # (4, 4)
    scene_model: str = ""  # name of the scene classifier; "" without one
    pose_estimate: str = ""  # how poses were estimated from the images; "": they were given
    detects: tuple[str, ...] = ()  # IRIs of the categories of its detector; (): unknown


@dataclass(frozen=True, slots=True)
class Assertion:
    """Assertion by a person of one property of an object or place, and the perceived value."""

    subject: str  # IRI of the object or place
    property: str  # "category", "position", "extent", "existence", "label", "on" ...
    value: str  # IRI of a category or object; numbers; "present"; "absent"; "nothing"; a label
    by: str
    stamp: float  # [s] when it was asserted
    perceived: str | None = None  # as `value`; for existence a number 0..1; None: unknown
    strength: float = 0.0  # belief of perception in `perceived`, 0..1
    since: float | None = None  # [s] start of the contradiction between both; None: they agree
    beliefs: Mapping[str, float] = field(default_factory=dict)  # perceived beliefs of a place


SearchState = Literal["running", "stopped", "found", "given up"]


@dataclass(frozen=True, slots=True)
class SearchRecord:
    """A search by a robot: its targets, its state and its result."""

    iri: str  # <base>search/N
    words: tuple[str, ...]  # the targets as given, e.g. "something to drink from"
    categories: tuple[str, ...]  # IRIs of the target categories
    state: SearchState
    started: float  # [s]
    ended: float | None = None  # [s] None: running
    seconds: float = 0.0  # [s] by the robot's clock, over all its runs
    left: float = 1.0  # probability that the remaining targets can still be found
    found: tuple[str, ...] = ()  # IRIs of objects


@dataclass(frozen=True, slots=True)
class LookRecord:
    """A look of a robot during a search, successful or not."""

    iri: str  # <search>/look/N
    search: str  # IRI
    number: int  # 1, 2, 3, ... within the search
    stamp: float  # [s]
    position: tuple[float, float]  # [m] of the robot
    heading: float  # [rad] middle of the viewed sector
    extent: float  # [rad] angle of the viewed sector, the field of view included
    categories: tuple[str, ...]  # IRIs of the target categories
    found: tuple[str, ...] = ()  # IRIs of the target objects in view
    glimpses: tuple[tuple[float, float, float], ...] = ()  # x, y, heading of pictures on the way


@dataclass(frozen=True, slots=True)
class ObstacleRecord:
    """A position where a robot on a search was blocked."""

    iri: str  # <search>/obstacle/N
    search: str  # IRI
    number: int
    stamp: float  # [s]
    position: tuple[float, float]  # [m]
    reason: str


#: states of a cell of the floor
UNKNOWN: Final = 0  # never viewed
FREE: Final = 1
LOW: Final = 2  # an obstacle below the camera: a table, a bed
TALL: Final = 3  # an obstacle that blocks the view: a wall, a cupboard


@dataclass(frozen=True, slots=True, eq=False)
class FloorTile:
    """A square of the floor of one storey, cell by cell."""

    storey: int  # 0, 1, 2, ...; in the order of discovery
    column: int  # number of the tile along x
    row: int  # number of the tile along y
    height: float  # [m] of the floor in the map frame
    resolution: float  # [m] side of a cell
    cells: NDArray[np.uint8]  # (n, n) cells (x, y): UNKNOWN, FREE, LOW or TALL
    changed: float  # [s] stamp of the last frame that changed the tile
    #: (2, m, m) [min since 1970] last view of each of m x m larger cells: from close by, and from
    #: any distance; 0: never viewed. None: unknown.
    viewed: NDArray[np.uint32] | None = None

    @property
    def corner(self) -> tuple[float, float]:
        """(x, y) [m] of the corner with the lowest coordinates."""
        span = len(self.cells) * self.resolution
        return self.column * span, self.row * span


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """Changes of one frame, applied as one transaction or not at all.

    `objects` and `places` hold whole records; the writer finds the triples that differ. `removed`
    holds IRIs of objects, places and doors that left the map, and of departed objects to forget.
    `departed` holds the records under which removed objects are remembered.
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
