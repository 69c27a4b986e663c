"""What a map is read for: records of all its kinds, what people said, and answers to questions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.blank_nodes import anonymous
from kg.categories import Catalogue
from kg.facts import Facts
from kg.floor import tile_of, tiles_in
from kg.history.remembering import Remembering
from kg.names import Names
from kg.questions import (
    Question,
    Table,
    any_question,
    evaluate,
    find_question,
    free_question,
    load_question,
)
from kg.records import (
    Assertion,
    FloorTile,
    LookRecord,
    ObjectRecord,
    ObstacleRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
    SearchRecord,
)
from kg.sayings import Sayings
from kg.searches import looks_in, obstacles_in, searches_in


class Reading(Remembering):
    """A map that is read; `base` is its own IRI, `catalogue` knows the categories."""

    catalogue: Catalogue
    _facts: Facts
    _sayings: Sayings

    def robot(self) -> RobotRecord | None:
        """Where the robot was last, if it ever was."""
        return self._facts.robot(self.engine)

    def objects_among(self, quads: Iterable[Quad]) -> tuple[ObjectRecord, ...]:
        """The objects that `quads` of graph:map tell of, oldest first: what was read, read once."""
        return self._facts.objects_among(quads)

    def floor(self) -> tuple[FloorTile, ...]:
        """The floor as depth frames showed it, by storey, column and row; empty without any."""
        return tiles_in(self.engine)

    def floor_tile(self, iri: str) -> FloorTile | None:
        """The tile of the floor with IRI `iri`, if there is one."""
        return tile_of(self.engine, iri)

    def recordings(self) -> tuple[RecordingRecord, ...]:
        """How far each recording has been applied, by name."""
        return self._facts.recordings(self.engine)

    def searches(self) -> tuple[SearchRecord, ...]:
        """The searches that robots made on this map, oldest first."""
        return searches_in(self.engine)

    def looks(self, search: str) -> tuple[LookRecord, ...]:
        """The looks of the search with IRI `search`, in their order."""
        return looks_in(self.engine, search)

    def obstacles(self, search: str) -> tuple[ObstacleRecord, ...]:
        """What stood in the way of the search with IRI `search`, in order."""
        return obstacles_in(self.engine, search)

    def ontology(self) -> tuple[Quad, ...]:
        """The quads of this map's ontology, with blank nodes, sorted."""
        graph = NamedNode(v.ONTOLOGY_GRAPH)
        quads = self.engine.quads_for_pattern(None, None, None, graph)
        return tuple(sorted(anonymous(quads), key=str))

    def assertions(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """What people said, and what perception believes of it; of one thing or of all."""
        return self._sayings.said(iri)

    def conflicts(self) -> tuple[Assertion, ...]:
        """The assertions that perception contradicts, with since when and how strongly."""
        return tuple(said for said in self.assertions() if said.since is not None)

    def perceived_objects(self, iris: Iterable[str] | None = None) -> tuple[ObjectRecord, ...]:
        """Objects as perception alone believes them, as `apply` takes them; all, or some."""
        return self._sayings.objects(None if iris is None else tuple(iris))

    def perceived_places(self) -> tuple[PlaceRecord, ...]:
        """Places as perception alone believes them, as `apply` takes them."""
        return self._sayings.places()

    def query(self, question: str | Path, **parameters: object) -> Table:
        """The answer to any question: the name of a shipped one, a ``.rq`` file, or SPARQL.

        What has a blank in it is SPARQL; `ask`, `ask_file` and `ask_text` are the three by name,
        and say what is raised.
        """
        return self._answer(any_question(question, parameters), parameters)

    def ask(self, question: str, **parameters: object) -> Table:
        """The answer to the shipped question of that name.

        A `category` parameter takes a label ("banana") or an IRI, a `place` parameter a label, a
        number or an IRI. Raises UnknownQueryError, QueryParameterError, UnknownCategoryError.
        """
        return self._answer(find_question(question), parameters)

    def ask_file(self, path: Path | str, **parameters: object) -> Table:
        """The answer to the question in a query file (`kg.questions` has the format)."""
        return self._answer(load_question(path), parameters)

    def ask_text(self, sparql: str, **parameters: object) -> Table:
        """The answer to a SPARQL query, prefixes predeclared, over the union of all named graphs.

        Relative IRIs are the map's: ``<object/17>``. CONSTRUCT and DESCRIBE give a TripleTable.
        Raises QueryError for what does not parse, would write, or would reach out to another
        endpoint.
        """
        return self._answer(free_question(sparql, parameters), parameters)

    def _answer(self, question: Question, parameters: dict[str, object]) -> Table:
        sparql = question.bind(parameters, self._resolve)
        return question.check(evaluate(self.engine, sparql, question.name, base=self.base))

    def _resolve(self, kind: str, text: str) -> str:
        return Names(self.engine, self.base, self.catalogue, self._places).resolve(kind, text)

    def _places(self) -> tuple[PlaceRecord, ...]:
        return self._facts.places(self.engine)
