"""Mapping options: the rules by which frames become a map, chosen once and passed whole."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from mapping.labels.label_resolver import LabelTable
from mapping.looks.user_encoder import UserEncoder
from mapping.objects.settings import ObjectSettings
from mapping.places.layout import Layout
from mapping.reference.settings import ReferenceSettings

Mode = Literal["bayes", "reference"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MappingOptions:
    """Options of `Mapper` and `map_recording`.

    Attributes:
        mode: "bayes" (`mapping.objects.bayes_mapper`), or "reference": the thesis' objects.
        objects: settings of the Bayes mapper.
        reference: settings of the reference mapper. The Bayes mapper uses its settings of places
            and of unknown labels.
        layout: areas of the places. Without it the stream gets one place that grows with the area
            that the camera has seen.
        find_places: whether the rooms of the mapped floor become places too; this needs
            `occupancy`. Where there are rooms, the stream's own place is one of them.
        labels: categories of the networks' labels; they have precedence over the ontology.
        occupancy: whether depth also goes into the occupancy map of the floor.
        same_frame: whether a recording's world is the map frame, so that `map_recording` does not
            require its floor to fit the map.
        check_poses: whether poses are compared with the depth. Jumps and drift give a warning
            (`mapping.frames.pose_monitor`), another pose convention is an error
            (`mapping.frames.frame_checks`).
        pictures: whether a small picture of each object is kept in the map's folder
            (`mapping.keepers.picture_keeper`). Pictures of people are never kept.
        surface: side [m] of the voxels that keep the surface of the room beside the map
            (`mapping.surface`), without people; None: no surface. A map that has voxels keeps
            their side. A map on a server keeps none.
        things: whether things without a name are found, which needs the surface
            (`mapping.things`); only the Bayes mapper does so.
        encoder: the user's encoder (`mapping.looks.user_encoder.remembered`), by which pictures of
            things and key views are compared with texts; it needs `pictures` and a map in a folder.
    """

    mode: Mode = "bayes"
    objects: ObjectSettings = field(default_factory=ObjectSettings)
    reference: ReferenceSettings = field(default_factory=ReferenceSettings)
    layout: Layout | None = None
    find_places: bool = False
    labels: LabelTable = field(default_factory=LabelTable)
    occupancy: bool = True
    same_frame: bool = False
    check_poses: bool = True
    pictures: bool = True
    surface: float | None = 0.025
    things: bool = True
    encoder: UserEncoder | None = None

    @property
    def min_score(self) -> float:
        """Score below which the mode ignores detections."""
        return self.objects.min_score if self.mode == "bayes" else self.reference.min_score


#: the options of a call that gives none
DEFAULT_OPTIONS = MappingOptions()
