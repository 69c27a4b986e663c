"""Scene keepers: what frames show beside objects and places, kept in the folder of the map.

Surface, things without a name, key views and pictures. Each takes in a frame before its
transaction, and counts it once the transaction is in the map.
"""

from __future__ import annotations

from collections.abc import Sequence

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import ModelError
from kg.model.records import MapUpdate, ObjectRecord
from mapping.keepers.look_keeper import LookKeeper
from mapping.keepers.picture_keeper import SURE, PictureKeeper, people_in
from mapping.key_views.view_store import ViewKeeper
from mapping.mapping_options import MappingOptions
from mapping.objects.extents.surface_growth import Voxels
from mapping.objects.object_mapper import ObjectChanges
from mapping.objects.reidentification.moves import LookRatio
from mapping.places.place_registry import PlaceRegistry
from mapping.runs.progress_report import StageTimer
from mapping.surface.surface_mapper import SurfaceMapper
from mapping.things.thing_mapper import ThingMapper
from perception.annotate import Boxes, Image
from perception.frames import Detections, Frame


class SceneKeepers:
    """The scene keepers of one stream, as `options` choose them; `timer` measures them."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        options: MappingOptions,
        places: PlaceRegistry,
        recording: str,
        timer: StageTimer,
    ) -> None:
        self._timer = timer
        self._surface: SurfaceMapper | None = None
        self._things: ThingMapper | None = None
        if options.surface is not None:
            self._surface = SurfaceMapper(semantic_map, options.surface, recording)
            if options.things and options.mode == "bayes":
                pictures = options.pictures
                self._things = ThingMapper(semantic_map, places, recording, pictures=pictures)
        self._views = ViewKeeper(semantic_map, recording)
        if options.encoder is not None and not options.pictures:
            raise ModelError("an encoder compares pictures, and no pictures are to be kept")
        encoder = options.encoder
        self._looks = None if encoder is None else LookKeeper(semantic_map, encoder)
        self._shown: tuple[Image, Boxes] | None = None  # the frame, and people that are sure
        self.pictures: PictureKeeper | None = None
        if options.pictures:
            self.pictures = PictureKeeper(semantic_map, recording, self._looks)

    @property
    def voxels(self) -> Voxels | None:
        """Reads the surface's voxels in a box; None without a surface."""
        return None if self._surface is None else self._surface.within

    @property
    def looks(self) -> LookRatio | None:
        """Compares looks of objects by their pictures; None without pictures."""
        moved = None if self.pictures is None else self.pictures.moved
        return None if moved is None else moved.ratio

    def add(self, frame: Frame, detections: Detections) -> None:
        """Add a frame; one that was not accepted is forgotten."""
        people = people_in(detections)
        with self._timer.stage("surface"):
            self._views.add(frame, people)
            if self._surface is not None:
                self._surface.add(frame, people)
            if self._things is not None:
                self._things.add(frame, people)
        if self.pictures is not None:
            self.pictures.see(frame, detections)
        if self._looks is not None:
            self._shown = frame.rgb, people_in(detections, SURE)

    def save(self, sequence: int) -> None:
        """Store the frame beside the map, before its transaction of that number."""
        if self._surface is not None:
            with self._timer.stage("surface"):
                self._surface.save(sequence)
        self._views.save(sequence)

    def accept(self, update: MapUpdate, joined: tuple[tuple[str, str], ...]) -> None:
        """Count the frame, whose transaction `update` is in the map now.

        `joined` has the IRIs of objects that are no more, and of those that they turned out to be.
        """
        if self._surface is not None:
            with self._timer.stage("surface"):
                self._surface.accept()
        view = self._views.accept()
        if self._looks is not None and self._shown is not None and view is not None:
            self._looks.add_view(view, *self._shown)
        if self.pictures is not None:
            self.pictures.keep(update, joined)

    def things(self, named: Sequence[ObjectRecord]) -> ObjectChanges:
        """Changes that make the map's things without a name those of the surface.

        A thing in the box of one of the `named` objects is that object.
        """
        if self._surface is None or self._things is None:
            return ObjectChanges()
        with self._timer.stage("surface"):
            return self._things.changes(self._surface.surface(), named)

    def finish(self) -> None:
        """Write the rest, after the last transaction."""
        if self._things is not None:
            self._things.keep_pictures()
        if self._surface is not None:
            self._surface.finish()
        if self.pictures is not None:
            self.pictures.finish()
        if self._looks is not None:
            self._looks.finish()

    @property
    def problems(self) -> tuple[str, ...]:
        """Problems of surface and known things so far, one line for each kind."""
        surface = () if self._surface is None else self._surface.problems
        known = "" if self.pictures is None else self.pictures.problem
        return surface + (known,) * bool(known)
