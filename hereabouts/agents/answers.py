"""Answers of the tools: typed, and with a mark on every text of the map.

Fields named ``untrusted_...`` hold what people, detectors or other programs wrote. Their types
escape and cut it (`hereabouts.agents.plain_values`), whoever fills them. A `validation_alias` is
the attribute of the planner's record that a field is read from.
`hereabouts.agents.lean_tool` writes an answer without empty fields, and cuts it.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from hereabouts.agents.plain_values import ADDRESS, LABEL, SENTENCE, escaped, time_or_none

Label = Annotated[str, BeforeValidator(lambda v: escaped(v, LABEL))]
Sentence = Annotated[str, BeforeValidator(lambda v: escaped(v, SENTENCE))]
Iri = Annotated[str, BeforeValidator(lambda v: escaped(v, ADDRESS))]
Cell = Annotated[
    str | float | int | bool | None,
    BeforeValidator(lambda v: escaped(v, SENTENCE) if isinstance(v, str) else v),
]
Metres = Annotated[float, BeforeValidator(lambda v: round(float(v), 2))]
Share = Annotated[float, BeforeValidator(lambda v: round(float(v), 3))]  # 0..1
Time = Annotated[str | None, BeforeValidator(time_or_none)]
Reasons = Annotated[list[Sentence], BeforeValidator(lambda v: v[:3])]  # the weightiest
StatusValue = Literal["present", "gone", "looked, none seen", "hidden", "never looked"]


class _Record(BaseModel):
    model_config = ConfigDict(
        frozen=True, from_attributes=True, validate_by_alias=True, validate_by_name=True
    )


class MapState(_Record):
    """`sequence` is the number of the last transaction, `time` that of the latest observation."""

    sequence: int
    time: str


class ToolAnswer(_Record):
    """The fields of every answer; `listed` names the list that pages cut, "" without one."""

    listed: ClassVar[str] = ""
    map: MapState


class Page(ToolAnswer):
    """A part of a list: `total` counts all entries, `skip` those before the page."""

    total: int
    skip: int = 0


class Thing(_Record):
    """An object of the map; metres in the map frame, z up; `probability` that it exists."""

    id: Iri
    untrusted_label: Label | None = None
    untrusted_category: Label
    probability: Share
    x: Metres | None = None
    y: Metres | None = None
    z: Metres | None = None
    untrusted_place: Label | None = None
    last_seen: str | None = None
    observations: int | None = None
    distance: Metres | None = None  # from the thing or point in the query
    relation: str | None = None  # on or inside the thing in the query


class LocatedThing(Thing):
    """An object with its whereabouts in words, and other categories that it may have.

    `still_there`: that it exists, and was not moved since it was last seen.
    """

    still_there: Share | None = None
    untrusted_where: Sentence | None = None
    untrusted_may_be: list[tuple[Label, Share]] | None = None
    untrusted_frame: Label | None = None
    untrusted_category_by: Label | None = None  # who said so, if a person gave the category
    untrusted_detected_as: Label | None = None  # what `observations` counts then
    found_by: Iri | None = None


class Departed(_Record):
    """A thing that left its spot and was not found elsewhere; it is no object of the map now."""

    id: Iri
    untrusted_label: Label
    untrusted_place: Label | None
    x: Metres  # where it stood
    y: Metres
    last_seen: str | None
    found_gone: str | None  # when its spot was first seen empty


class Things(Page):
    """Objects, the surest, the nearest or the latest first."""

    listed: ClassVar[str] = "things"
    things: list[Thing]
    place: Iri | None = None  # that a point is in
    untrusted_place: Label | None = None


class WhereIs(Page):
    """Objects that match the query, the surest first; without any, the proof of absence."""

    listed: ClassVar[str] = "things"
    things: list[LocatedThing]
    departed: list[Departed] | None = None
    status: StatusValue | None = None  # if no thing is known, or none more probably than not
    untrusted_proof: Sentence | None = None
    untrusted_understood: Sentence | None = None  # how the word was read, if not as a category


class QuestionAnswer(ToolAnswer):
    """The answer to a plain question, and how it was understood."""

    kind: str
    untrusted_answer: list[Sentence]


class ChangedThing(_Record):
    """One change of an object or room since a moment; positions are x, y, z in metres."""

    kind: Literal["appeared", "gone", "moved", "relabelled", "reshaped"]
    id: Iri
    untrusted_category: Label  # of an object; the name of a room
    place: Iri | None  # where it is, or was if it is gone
    was: list[Metres] | None  # its former position
    now: list[Metres] | None
    moved_metres: Metres | None
    untrusted_before: Label | None  # its former name; of a room that is reshaped, its area
    untrusted_after: Label | None


class Changed(Page):
    """Changes of objects: appeared, gone, moved (the farthest first), relabelled; then of rooms."""

    listed: ClassVar[str] = "things"
    since: str  # the moment of writing compared with: later than asked if the history is shorter
    things: list[ChangedThing]
    floor_seen: list[float]  # [m^2] then and now
    surface_seen: list[float]


class StatusInPlace(_Record):
    """Status in one place; shares of its area, 0..1."""

    place: Iri | None
    untrusted_place: Label = Field(validation_alias="place_label")
    status: StatusValue = Field(validation_alias="value")
    thing: Iri | None = Field(validation_alias="object")
    probability: Share | None = Field(validation_alias="existence")
    last_seen: Time
    viewed_share: Share
    closely_viewed_share: Share
    last_viewed: Time
    noticed: Share  # probability that one would have been seen
    out_of_view: Share  # probability that one there would stand where nobody viewed


class StatusAnswer(Page):
    """Present, gone (it was there), looked and none seen, hidden, or never looked; the proof."""

    listed: ClassVar[str] = "places"
    status: StatusValue
    untrusted_target: Label
    untrusted_proof: Sentence
    places: list[StatusInPlace]


class Step(_Record):
    """A step of an explanation; the steps that explain it follow, one deeper."""

    depth: int
    kind: str
    untrusted_text: Sentence
    id: Iri | None  # if the text does not have it


class WhyAnswer(Page):
    """The provenance of a thing or fact: frames, rules, models, sources, people."""

    listed: ClassVar[str] = "steps"
    steps: list[Step]


class HistoryEntry(_Record):
    """A transaction that changed the thing."""

    sequence: int
    time: str
    kind: str
    untrusted_by: Label | None
    untrusted_note: Sentence
    untrusted_changes: list[Label]
    changes_left_out: int | None


class HistoryAnswer(Page):
    """The transactions that changed a thing, the latest first."""

    listed: ClassVar[str] = "events"
    events: list[HistoryEntry]


class PictureOf(ToolAnswer):
    """The observation that a picture shows; `box` is x0, y0, x1, y1 [px] in its frame."""

    thing: Iri
    untrusted_category: Label
    untrusted_recording: Label
    untrusted_frame: Label
    box: list[int]
    time: str


class AlikeViewOf(ToolAnswer):
    """The key view that looks most like a text: a pose to drive to, and never a fact."""

    x: Metres
    y: Metres
    heading: Metres  # [rad]
    untrusted_recording: Label
    untrusted_frame: Label
    encoder: str


class ThingsToName(ToolAnswer):
    """Things in the order of the pictures that follow; those without a name come first."""

    things: list[Iri]
    untrusted_categories: list[Label]


class RouteDoor(_Record):
    """A spot where a way leads from one place into another; `id` is a door that the map has."""

    id: Iri | None
    between: list[Iri]
    untrusted_into: Label
    x: Metres
    y: Metres
    width: Metres | None


class RouteAnswer(Page):
    """The shortest known way over the floor; `unseen_metres` of it lie on floor nobody saw."""

    listed: ClassVar[str] = "doors"
    reachable: bool
    metres: Metres | None = None
    seconds: Metres | None = None
    end: list[Metres] | None = None  # x, y: the floor nearest to the goal
    end_to_goal: Metres | None = None  # from there in a straight line
    unseen_metres: Metres | None = None
    notes: list[Sentence] | None = None  # where an end is off the floor
    doors: list[RouteDoor] = []  # in order


class Look(_Record):
    """A position and a direction to look in; metres, radians, seconds since the start."""

    x: Metres
    y: Metres
    heading: Metres
    extent: Metres  # angle that the look covers [rad], around heading
    place: Iri | None
    probability: Share  # that this look finds it first
    seconds: Metres
    metres: Metres
    left: Share  # probability that it exists and is not found by then
    reasons: list[Iri]  # objects and places that it shows, the weightiest first
    untrusted_why: Sentence | None


class PlanAnswer(Page):
    """A search plan: looks in their order, without those that gain too little for their time."""

    listed: ClassVar[str] = "looks"
    untrusted_answer: list[Sentence]
    known: list[LocatedThing]  # matching objects of the map
    present: Share | None  # probability that it is on this floor
    probability: Share | None  # that the whole plan finds it
    expected_seconds: Metres | None
    further_looks: int | None  # that gain too little for their time
    note: Sentence | None = None  # where the start is off the floor
    looks: list[Look]


class ProposedLook(_Record):
    """A position, and the things to look at from it; m, rad, and seconds until the look is over."""

    x: Metres
    y: Metres
    heading: Share = Field(validation_alias="middle")  # direction of the look [rad]
    extent: Share  # angle that the look covers [rad], around heading
    untrusted_place: Label = Field(validation_alias="place")
    probability: Share  # that it shows a wanted object
    seconds: Metres
    left_if_in_vain: Share = Field(validation_alias="left")  # that it is still there
    untrusted_reasons: Reasons = Field(validation_alias="why")


class ReportedThing(_Record):
    """A wanted object that a look showed, and its position: metres in the map frame."""

    what: Annotated[str, Field(min_length=1, max_length=100, description="word of the search")]
    x: Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]
    y: Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]


class SearchProgress(ToolAnswer):
    """The progress of a search; `search` is its name, for next_look and report_look."""

    search: str
    state: Literal["searching", "found", "given up"]
    untrusted_wanted: list[Label]  # objects not found yet
    looks_reported: int
    left: Annotated[float, BeforeValidator(lambda v: round(float(v), 6))]


class NextLook(SearchProgress):
    """The look to take now; none if all is found, or if no look is worth the way."""

    look: ProposedLook | None
    note: Sentence | None = None  # where the robot is off the floor


class PlaceSummary(_Record):
    """A place with its most probable category and the share of it that was viewed."""

    id: Iri
    untrusted_label: Label
    untrusted_category: Label | None
    probability: Share | None  # of that category
    viewed_share: Share | None
    last_viewed: str | None
    x: list[Metres]  # from, to
    y: list[Metres]
    untrusted_note: Sentence | None = None  # of a person
    untrusted_note_by: Label | None = None


class Pose(_Record):
    """The pose of the robot; metres, radians."""

    x: Metres
    y: Metres
    heading: Metres
    time: str


class MapDescription(Page):
    """Title and content of the map, and whether it may be changed; the list is of places."""

    listed: ClassVar[str] = "places"
    untrusted_title: Label
    base: Iri
    created: str | None
    licence: Iri | None
    objects: int
    categories: int
    untrusted_counts: list[tuple[Label, int]]  # the most frequent categories
    without_name: int | None  # further things; the tool picture shows them
    robot: Pose | None
    writable: bool
    places: list[PlaceSummary]


class Rows(Page):
    """A SPARQL answer; times are ISO 8601, IRIs text. The notes tell why nothing may match."""

    listed: ClassVar[str] = "untrusted_rows"
    untrusted_columns: list[Label]
    untrusted_rows: list[list[Cell]]
    notes: list[Sentence] = Field(default_factory=list)  # terms of the query that the map lacks


class Written(ToolAnswer):
    """The assertion made or retracted; `changed` is false if nothing changed.

    The notes tell of values of other people that it replaced, and of what is odd.
    """

    thing: Iri
    property: str
    untrusted_value: Sentence | None
    untrusted_by: Label | None
    untrusted_perceived: Sentence | None
    contradicted: bool  # whether perception believes otherwise
    changed: bool
    untrusted_notes: list[Sentence] | None = None
