"""Codec of records and quads, as docs/explanation/architecture.md draws them.

Numbers are quantised when they become facts (positions to 1 cm, shares to 0.01, times to 1 s), so
that noise below the map's accuracy causes no write. Missing properties have default values, since a
person may add an object by SPARQL with only a class and a position.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.facts.observations import (
    evidence_of,
    facts_of_views,
    label_quads,
    labels_of,
    observation_quads,
    views_of,
)
from kg.maps.facts.spatial_relations import relation_quads, relations_of
from kg.model import vocabulary as v
from kg.model.areas import Area, Outline, area_of
from kg.model.errors import InvalidFactError
from kg.model.iris import observation_iri
from kg.model.records import (
    MAX_DEVIATION,
    DepartedRecord,
    Evidence,
    ObjectRecord,
    PlaceRecord,
    likeliest,
)
from kg.rdf.literals import (
    AXES,
    SIDES,
    Properties,
    area_of_polygon,
    axes_of,
    axis_literals,
    by_subject,
    cell_of,
    first,
    iri_node,
    iri_order,
    known_iri,
    number_literal,
    polygon_text,
    properties_of,
    quantised,
    share_literal,
    stamp_of,
    subject_quads,
    time_literal,
    yaw_literals,
)
from kg.rdf.quad_store import QuadStore
from kg.rdf.standard_terms import CRS
from kg.store.scheduling import in_pieces
from kg.store.sparql_backend import reading_ahead

CHUNK_SIZE = 50  # subjects read before a frame that waits may be written
_MAX_OBSERVED = 4096  # objects whose observation is held
MIN_BELIEF = 0.005  # smaller beliefs would be stored as zero


class RecordCodec:
    """Codec of records and quads for the map with IRI `base`.

    `catalogue` has the categories, or reads them when they are first needed.
    """

    def __init__(self, base: str, catalogue: Catalogue | Callable[[], Catalogue]) -> None:
        self.base = base
        self._catalogue = catalogue
        self._observed = dict[str, tuple[Evidence, list[Quad]]]()  # latest of each object

    @property
    def catalogue(self) -> Catalogue:
        """The categories of the map's ontology."""
        return self._catalogue if isinstance(self._catalogue, Catalogue) else self._catalogue()

    def of_object(self, record: ObjectRecord) -> list[Quad]:
        """Facts of an object, its observation, its relations and its alternative classes.

        Raises InvalidFactError for numbers that are not finite or out of range, and for a category
        the ontology does not know.
        """
        what = f"object {record.iri}"
        if record.observations < 1:
            raise InvalidFactError(
                f"{what}: observations must be 1 or more, got {record.observations}"
            )
        if record.first_seen > record.last_seen:
            raise InvalidFactError(f"{what}: first seen must not be after last seen")
        position = axis_literals(AXES, record.p_map, f"{what}: position")
        x, y = (float(value.value) for _, value in position[:2])
        facts: list[tuple[str, NamedNode | Literal]] = [
            (v.RDF_TYPE.value, known_iri(self.known_category(record.category, what, "object"))),
            (v.RDFS_LABEL, Literal(self.object_label(record))),
            *position,
            (v.IN_CELL, known_iri(cell_of(x, y))),
            (v.CONFIDENCE, _confidence(record.confidence, f"{what}: confidence")),
            (v.EXISTENCE, share_literal(record.existence, f"{what}: existence")),
            (v.OBSERVATION_COUNT, Literal(record.observations)),
            (v.FIRST_SEEN, time_literal(record.first_seen, f"{what}: first seen")),
            (v.LAST_SEEN, time_literal(record.last_seen, f"{what}: last seen")),
        ]
        if record.place is not None:
            facts.append((v.IN_PLACE, iri_node(record.place, f"{what}: place")))
        facts += _extent(record, what)
        for category in record.labels:
            self.known_category(category, what, "object")
        parts = relation_quads(record.iri, record.relations or ())
        parts += label_quads(record.iri, record.labels)
        if record.evidence is None:
            return subject_quads(record.iri, facts) + parts
        facts.append((v.EXPLAINED_BY, NamedNode(observation_iri(self.base, record.iri))))
        evidence = self._observation(record.iri, record.evidence)
        return subject_quads(record.iri, facts) + evidence + parts

    def _observation(self, iri: str, evidence: Evidence) -> list[Quad]:
        """Facts of an object's best observation, which most frames that show it leave as it is."""
        held, quads = self._observed.get(iri, (None, []))
        if held is not evidence:
            quads = observation_quads(iri, evidence, self.base)
            if len(self._observed) >= _MAX_OBSERVED:
                self._observed.clear()
            self._observed[iri] = evidence, quads
        return quads

    def of_place(self, record: PlaceRecord) -> list[Quad]:
        """Facts of a place and of its beliefs; raises InvalidFactError as `of_object` does."""
        what = f"place {record.iri}"
        if record.outline:
            record = record.with_area(_quantised_area(record.outline, what))
        if not (record.xmin < record.xmax and record.ymin < record.ymax):
            raise InvalidFactError(
                f"{what}: a rectangle needs xmin < xmax and ymin < ymax, got "
                f"x {record.xmin:g}..{record.xmax:g}, y {record.ymin:g}..{record.ymax:g}"
            )
        if record.views < 0:
            raise InvalidFactError(f"{what}: views must be 0 or more, got {record.views}")
        x, y = record.area.centre
        outline: list[tuple[str, Literal]] = []
        if record.outline:
            text = polygon_text(record.outline, self.base + CRS)
            outline = [(v.OUTLINE, Literal(text, datatype=v.GEO_WKT_LITERAL))]
        facts: list[tuple[str, NamedNode | Literal]] = [
            (v.RDF_TYPE.value, known_iri(v.PLACE)),
            (v.RDF_TYPE.value, known_iri(v.BOT_SPACE)),
            (v.RDFS_LABEL, Literal(record.label)),
            (v.X_MIN, number_literal(record.xmin, f"{what}: xmin")),
            (v.X_MAX, number_literal(record.xmax, f"{what}: xmax")),
            (v.Y_MIN, number_literal(record.ymin, f"{what}: ymin")),
            (v.Y_MAX, number_literal(record.ymax, f"{what}: ymax")),
            (v.X, number_literal(x, f"{what}: x")),
            (v.Y, number_literal(y, f"{what}: y")),
            (v.VIEW_COUNT, Literal(record.views)),
            *outline,
            *((v.BOT_ADJACENT_ZONE, iri_node(iri, f"{what}: adjacent")) for iri in record.adjacent),
            *facts_of_views(record.viewed, what),
        ]
        if record.from_floor:
            facts.append((v.FROM_FLOOR, Literal(True)))
        beliefs = self.of_beliefs(record)
        facts += [(v.TOLD_BY, iri_node(iri, f"{what}: told by")) for iri in record.evidence_objects]
        top = likeliest(record.beliefs)
        if (record.views or record.evidence_objects) and top is not None:
            facts.append((v.RDF_TYPE.value, NamedNode(top)))
        return subject_quads(record.iri, facts) + beliefs

    def of_beliefs(self, record: PlaceRecord) -> list[Quad]:
        """Quads of a place's category beliefs, links included."""
        nodes: list[Quad] = []
        scene = record.scene_beliefs if record.evidence_objects else {}
        what = f"place {record.iri}: belief"
        for category in sorted(record.beliefs.keys() | scene.keys()):
            self.known_category(category, what, "place")
            belief, views = record.beliefs.get(category, 0.0), scene.get(category, 0.0)
            facts: list[tuple[str, NamedNode | Literal]] = [
                (v.RDF_TYPE.value, known_iri(v.PLACE_BELIEF)),
                (v.OF_CATEGORY, NamedNode(category)),
                (v.BELIEF, share_literal(belief, what)),
                (v.SCENE_BELIEF, share_literal(views, what)),
            ]
            if max(belief, views) >= MIN_BELIEF:
                node = f"{record.iri}/belief/{quote(category.removeprefix(v.HERE), safe='')}"
                nodes += subject_quads(record.iri, [(v.HAS_BELIEF, NamedNode(node))])
                nodes += subject_quads(node, facts if views >= MIN_BELIEF else facts[:-1])
        return nodes

    def objects(self, store: QuadStore) -> tuple[ObjectRecord, ...]:
        """All objects of the map with a name, in the order of their numbers."""
        return self.objects_among(store.quads_for_pattern(None, None, None, v.MAP_GRAPH))

    def objects_among(self, quads: Iterable[Quad]) -> tuple[ObjectRecord, ...]:
        """The objects described by `quads` of graph:map, in the order of their numbers."""
        return self.objects_of(by_subject(in_pieces(quads, 10 * CHUNK_SIZE)))

    def objects_of(self, subjects: dict[str, Properties]) -> tuple[ObjectRecord, ...]:
        """The objects among things with those properties, in the order of their numbers."""
        found = self._objects(subjects)
        return tuple(record for record in found if record.category != v.UNNAMED_THING)

    def unnamed_things(self, store: QuadStore) -> tuple[ObjectRecord, ...]:
        """All things without a name, in the order of their numbers."""
        kind = NamedNode(v.UNNAMED_THING)
        quads = store.quads_for_pattern(None, v.RDF_TYPE, kind, v.MAP_GRAPH)
        return self.some_objects(
            store, [q.subject.value for q in quads if isinstance(q.subject, NamedNode)]
        )

    def some_objects(self, store: QuadStore, iris: Iterable[str]) -> tuple[ObjectRecord, ...]:
        """The objects among `iris`, in the order of their numbers."""
        nodes = [iri_node(iri, "object") for iri in dict.fromkeys(iris)]
        with reading_ahead(store, nodes):
            subjects = {
                node.value: properties_of(store, node.value, v.MAP_GRAPH)
                for node in in_pieces(nodes, CHUNK_SIZE)
            }
        parts = {
            part
            for held in subjects.values()
            for link in (v.EXPLAINED_BY, v.HAS_RELATION, v.HAS_LABEL_BELIEF)
            for part in held.get(link, ())
        }
        with reading_ahead(store, map(NamedNode, parts)):
            subjects.update(
                (iri, properties_of(store, iri, v.MAP_GRAPH))
                for iri in in_pieces(parts, CHUNK_SIZE)
            )
        return self._objects(subjects)

    def _objects(self, subjects: dict[str, Properties]) -> tuple[ObjectRecord, ...]:
        found = []
        for iri, properties in subjects.items():
            category = self._category(properties)
            if category is None or v.X not in properties or v.Y not in properties:
                continue
            found.append(self._object(iri, category, properties, subjects))
        return tuple(sorted(found, key=lambda record: iri_order(record.iri)))

    def places(self, store: QuadStore) -> tuple[PlaceRecord, ...]:
        """All places of the map, in the order of their numbers."""
        subjects: dict[str, Properties] = {}
        quads = store.quads_for_pattern(None, v.RDF_TYPE, NamedNode(v.PLACE), v.MAP_GRAPH)
        nodes = [quad.subject for quad in quads if isinstance(quad.subject, NamedNode)]
        with reading_ahead(store, nodes):
            for node in in_pieces(nodes, CHUNK_SIZE):
                properties = subjects[node.value] = properties_of(store, node.value, v.MAP_GRAPH)
                for held in properties.get(v.HAS_BELIEF, ()):
                    subjects[held] = properties_of(store, held, v.MAP_GRAPH)
        found = (
            self._place(node.value, subjects[node.value], subjects)
            for node in nodes
            if v.X_MIN in subjects[node.value]
        )
        return tuple(sorted(found, key=lambda record: iri_order(record.iri)))

    def label(self, store: QuadStore, iri: str) -> str | None:
        """The label of a thing, if it has one."""
        return first(properties_of(store, iri, v.MAP_GRAPH), v.RDFS_LABEL, "") or None

    def known_category(self, iri: str, what: str, kind: str) -> str:
        """`iri`, a category of this `kind` or of both; raises InvalidFactError for another."""
        category = self.catalogue.by_iri(iri)
        if category is None:
            raise InvalidFactError(
                f"{what}: {iri!r} is no category of the ontology; find one with its catalogue"
            )
        if {category.kind, kind} == {"object", "place"}:
            raise InvalidFactError(
                f"{what}: {category.label!r} is a category of {category.kind}s; "
                f"find one of {kind}s with the catalogue"
            )
        return iri

    def object_label(self, record: ObjectRecord | DepartedRecord) -> str:
        """Default label of an object: its category and its number; a person's name as it is."""
        return self.catalogue.title(record.category, record.iri)

    def _category(self, properties: Properties) -> str | None:
        for iri in sorted(properties.get(v.RDF_TYPE.value, ())):
            category = self.catalogue.by_iri(iri)
            if category is not None and category.kind != "place":
                return iri
        return None

    def _object(
        self, iri: str, category: str, properties: Properties, subjects: dict[str, Properties]
    ) -> ObjectRecord:
        observation = subjects.get(first(properties, v.EXPLAINED_BY, ""))
        deviation = first(properties, v.DEVIATION, "")
        return ObjectRecord(
            iri=iri,
            category=category,
            p_map=axes_of(properties, AXES),
            confidence=float(first(properties, v.CONFIDENCE, "1")),
            existence=float(first(properties, v.EXISTENCE, "1")),
            observations=int(first(properties, v.OBSERVATION_COUNT, "1")),
            first_seen=stamp_of(properties, v.FIRST_SEEN),
            last_seen=stamp_of(properties, v.LAST_SEEN),
            place=first(properties, v.IN_PLACE, "") or None,
            evidence=None if observation is None else evidence_of(observation, self.base),
            extent=axes_of(properties, SIDES) if properties.keys() >= set(SIDES) else None,
            deviation=float(deviation) if deviation else None,
            relations=relations_of(properties, subjects),
            labels=labels_of(properties, subjects),
            yaw=float(first(properties, v.YAW, "0")),
        )

    def _place(
        self, iri: str, properties: Properties, subjects: dict[str, Properties]
    ) -> PlaceRecord:
        nodes = [subjects.get(held, {}) for held in sorted(properties.get(v.HAS_BELIEF, ()))]
        evidence_objects = tuple(sorted(properties.get(v.TOLD_BY, ()), key=iri_order))
        nodes = [node for node in nodes if v.OF_CATEGORY in node]
        beliefs, scene = (
            {first(node, v.OF_CATEGORY, ""): float(first(node, share, "0")) for node in stating}
            for share, stating in (
                (v.BELIEF, nodes),
                (v.SCENE_BELIEF, [node for node in nodes if v.SCENE_BELIEF in node]),
            )
        )
        if evidence_objects:
            beliefs = {category: belief for category, belief in beliefs.items() if belief > 0}
        xmin, xmax, ymin, ymax = (
            float(first(properties, edge, "nan")) for edge in (v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX)
        )
        label = first(properties, v.RDFS_LABEL, iri)
        views = int(first(properties, v.VIEW_COUNT, "0"))
        record = PlaceRecord(
            *(iri, label, xmin, xmax, ymin, ymax, views, beliefs),
            scene_beliefs=scene if evidence_objects else {},
            evidence_objects=evidence_objects,
            viewed=views_of(properties),
            from_floor=first(properties, v.FROM_FLOOR, "") in ("true", "1"),
            adjacent=tuple(sorted(properties.get(v.BOT_ADJACENT_ZONE, ()), key=iri_order)),
        )
        try:
            return record.with_area(area_of_polygon(first(properties, v.OUTLINE, "")))
        except ValueError:  # no outline, or one without an area
            return record


def _extent(record: ObjectRecord, what: str) -> list[tuple[str, NamedNode | Literal]]:
    """Facts of an object's box and of its position's precision, where they are known."""
    facts: list[tuple[str, NamedNode | Literal]] = []
    if record.extent is not None:
        facts += axis_literals(SIDES, record.extent, f"{what}: extent", minimum=0.0)
        facts += yaw_literals(record.yaw, what)
    if record.deviation is not None:
        what = f"{what}: position deviation"
        deviation = number_literal(record.deviation, what, minimum=0.0, maximum=MAX_DEVIATION)
        facts.append((v.DEVIATION, deviation))
    return facts


def _quantised_area(outline: Outline, what: str) -> Area:
    try:
        return area_of([[(quantised(x, what), quantised(y, what)) for x, y in r] for r in outline])
    except ValueError as error:
        raise InvalidFactError(f"{what}: {error}") from error


def _confidence(value: float, what: str) -> Literal:
    # above zero means "still in the map" (eq. 3.4), so it is never rounded to zero
    return Literal(0.01) if 0.0 < value < 0.01 else number_literal(value, what, minimum=0.0)
