"""What stands where: the reference's object rules, frame by frame (thesis section 3.3.1)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from kg.assertions import Said, believed_object
from kg.others import PerceivedObjects
from kg.records import Evidence, ObjectRecord
from kg.semantic_map import SemanticMap
from mapping.association import Sighting, associate, most_confident
from mapping.confidence import existence, lowered
from mapping.labels import LabelBook
from mapping.labels_map import LabelsMap
from mapping.localisation import localise, to_map
from mapping.place_book import PlaceBook
from mapping.settings import ReferenceSettings
from mapping.sighted import first_seen, seen_again
from mapping.visibility import missed
from perception.frame import Detections, Frame


@dataclass(frozen=True, slots=True)
class ObjectChanges:
    """What one frame changes about the objects, and what became of its detections."""

    updated: tuple[ObjectRecord, ...] = ()  # new, seen, missed, or in another place than before
    removed: tuple[str, ...] = ()  # IRIs
    new: int = 0
    seen: int = 0
    missed: int = 0


class ObjectMapper:
    """Turns detections into changes of the map's objects.

    Its state is the map's: loaded from the graph when made, ahead of it by rounding only, and read
    again where others wrote since the last frame. It holds what perception believes; what people
    asserted decides which detection is which object. `labels` knows what the detector's labels
    mean; `unplaced` counts detections without usable depth.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        settings: ReferenceSettings,
        places: PlaceBook | None = None,
        *,
        recording: str = "",
        model: str = "",
        labels: LabelsMap | None = None,
    ) -> None:
        self._map = semantic_map
        self._settings = settings
        self._places = places
        self._source = recording, model
        self._objects = PerceivedObjects(semantic_map)
        self._said: dict[str, Said] = {}
        self._hear(self._objects)
        self.labels = LabelBook(
            semantic_map, "object", table=labels, unknown=settings.unknown_labels, model=model
        )
        self._revision = -1
        self.unplaced = 0

    def objects(self) -> tuple[ObjectRecord, ...]:
        """Every object as the map believes it now."""
        return tuple(self._believed(record) for record in self._objects.values())

    def step(self, frame: Frame, detections: Detections) -> ObjectChanges:
        """Apply one frame: seen objects rise, new ones are registered, missed ones fall."""
        s = self._settings
        self.refresh()
        found = associate(self._sightings(frame, detections), tuple(self._candidates()), s.kappa)
        missing = self._missing(frame, found.matched)
        seen = [
            self._seen(self._objects[iri], frame, sighting)
            for iri, sighting in found.matched.items()
        ]
        in_range = [x for x in found.new if s.min_depth <= x.depth <= s.max_depth]
        new = [self._new(frame, x) for x in most_confident(in_range, s.kappa)]
        fallen = [self._lowered(record) for record in missing]
        removed = tuple(r.iri for r in fallen if r.confidence <= 0 and not self._kept(r.iri))
        for iri in removed:
            del self._objects[iri]
            self._said.pop(iri, None)
        changed = {r.iri: r for r in (*seen, *new, *fallen) if r.iri not in removed}
        self._objects |= changed
        changed |= self._moved()
        return ObjectChanges(tuple(changed.values()), removed, len(new), len(seen), len(fallen))

    def take_back(self, changes: ObjectChanges) -> None:
        """Forget the last step, whose changes could not be written."""
        self._objects.doubt((*(record.iri for record in changes.updated), *changes.removed))
        self._revision = -1

    def refresh(self) -> None:
        """Read again what others changed since the last frame; cheap where nothing was."""
        touched = self._objects.refresh()
        if not touched:
            return
        for iri in touched - self._objects.keys():
            self._said.pop(iri, None)
        self._hear(touched & self._objects.keys())

    def _hear(self, iris: Iterable[str]) -> None:
        """Take over what was said of some objects."""
        said: dict[str, Said] = {}
        for assertion in self._map.assertions():
            said[assertion.subject] = {
                **said.get(assertion.subject, {}),
                assertion.property: assertion,
            }
        for iri in iris:
            self._said.pop(iri, None)
            if iri in said:
                self._said[iri] = said[iri]

    def _believed(self, record: ObjectRecord) -> ObjectRecord:
        said = self._said.get(record.iri)
        return record if said is None else believed_object(record, said)

    def _candidates(self) -> Iterator[ObjectRecord]:
        """Objects as detections may show them: as asserted, and as perceived where that differs."""
        for record in self._objects.values():
            yield record
            if record.iri in self._said:
                believed = self._believed(record)
                yield believed
                yield replace(record, category=believed.category)
                yield replace(record, p_map=believed.p_map)

    def _kept(self, iri: str) -> bool:
        """Whether somebody said that the object is there."""
        existence = self._said.get(iri, {}).get("existence")
        return existence is not None and existence.value == "present"

    def _sightings(self, frame: Frame, detections: Detections) -> list[Sighting]:
        """Detections of known categories with a position in the map."""
        sightings = []
        least = self._settings.min_score
        self.labels.learn(
            label
            for label, score in zip(detections.label, detections.score, strict=True)
            if score >= least
        )
        for box, score, label in zip(
            detections.xyxy, detections.score, detections.label, strict=True
        ):
            category = self.labels.category(label)
            if category is None:
                continue
            if score < least:
                continue
            p_cam = localise(frame, box, self._settings)
            if p_cam is None:
                self.unplaced += 1
                continue
            x1, y1, x2, y2 = (float(v) for v in box)
            p_map = to_map(frame.T_map_cam, p_cam)
            sightings.append(
                Sighting(category, float(score), p_map, float(p_cam[2]), (x1, y1, x2, y2))
            )
        return sightings

    def _missing(self, frame: Frame, matched: Mapping[str, Sighting]) -> list[ObjectRecord]:
        """Registered objects that this frame should have shown and did not."""
        return [
            record
            for record in self._objects.values()
            if record.iri not in matched
            and missed(frame, self._believed(record).p_map, self._settings)
        ]

    def _seen(self, record: ObjectRecord, frame: Frame, sighting: Sighting) -> ObjectRecord:
        evidence = record.evidence
        if evidence is None or sighting.score > evidence.score:
            evidence = self._evidence(frame, sighting)
        after = seen_again(record, sighting, frame.stamp, self._settings)
        return replace(after, place=self._place(after), evidence=evidence)

    def _new(self, frame: Frame, sighting: Sighting) -> ObjectRecord:
        return replace(
            first_seen(self._map.new_object_iri(), sighting, frame.stamp, self._settings),
            place=self._places.at(sighting.p_map) if self._places else None,
            evidence=self._evidence(frame, sighting),
        )

    def _lowered(self, record: ObjectRecord) -> ObjectRecord:
        confidence = lowered(record.confidence, self._settings.xi)
        if self._kept(record.iri):
            confidence = max(confidence, 0.0)
        return replace(
            record,
            confidence=confidence,
            existence=existence(max(confidence, 0.0), self._settings.nu),
        )

    def _evidence(self, frame: Frame, sighting: Sighting) -> Evidence:
        recording, model = self._source
        return Evidence(frame.id, recording, frame.stamp, sighting.box, sighting.score, model)

    def _moved(self) -> dict[str, ObjectRecord]:
        """Objects that lie in another place since the places' rectangles changed."""
        if self._places is None or self._places.revision == self._revision:
            return {}
        self._revision = self._places.revision
        moved = {}
        for iri, record in self._objects.items():
            place = self._place(record)
            if place != record.place:
                moved[iri] = replace(record, place=place)
        self._objects |= moved
        return moved

    def _place(self, record: ObjectRecord) -> str | None:
        """The place that holds the object where the map believes it is."""
        return self._places.at(self._believed(record).p_map) if self._places else record.place
