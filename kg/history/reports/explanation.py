"""Explanation of facts: the frame, rule, model, source or person behind each.

An explanation is a tree: each step has the reasons behind it.
`kg.history.reports.prov_export` serialises the tree in SOSA and PROV-O.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal as Choice

from pyoxigraph import Literal, NamedNode, Quad

from kg.history.point_in_time import state_of
from kg.history.reports import explanation_rules as known
from kg.history.reports.explanation_rules import FactChanges, FactReader, same
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.timestamps import iso, short, statement, word
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError
from kg.model.iris import agent_iri, agent_name
from kg.model.records import SURFACE
from kg.model.usual_sizes import size_reason
from kg.rdf.literals import seconds
from kg.rdf.quad_store import QuadStore, Term

Kind = (
    Choice["thing", "fact", "was", "observation", "pose", "model", "rule"]
    | Choice["commit", "change", "person", "belief", "view", "relation", "source"]
)
MAX_VIEWS = 3  # frames listed as evidence for the belief of a place

_SUBJECT = NamedNode(v.RELATION_SUBJECT)
#: predicate of a fact -> asserted property that it follows from
_ASSERTED_PROPERTIES = {
    v.RDF_TYPE.value: "category",
    **dict.fromkeys((v.X, v.Y, v.Z, v.IN_CELL, v.IN_PLACE), "position"),
    **dict.fromkeys((v.EXTENT_X, v.EXTENT_Y, v.EXTENT_Z, v.YAW), "extent"),
    v.EXISTENCE: "existence",
    v.RDFS_LABEL: "label",
    v.ON: "on",
    v.INSIDE: "inside",
}


@dataclass(frozen=True, slots=True)
class Explanation:
    """One step of an explanation, and the reasons behind it."""

    kind: Kind
    text: str
    iri: str | None = None  # IRI of the subject of the step, if any
    because: tuple[Explanation, ...] = ()
    fact: tuple[Term, Term, Term] | None = None  # of a "fact" or "was"
    time: float | None = None  # [s since 1970] of a "commit" or "change"

    def walk(self, depth: int = 0) -> Iterator[tuple[int, Explanation]]:
        """This step and all steps behind it, each with its depth."""
        yield depth, self
        for reason in self.because:
            yield from reason.walk(depth + 1)


class Explainer(FactReader):
    """Explains the facts of `engine` from the transactions of `log`.

    If the past is not `recorded`, `log` has only the present facts.
    """

    def __init__(
        self, engine: QuadStore, log: HistoryLog, base: str, *, recorded: bool = True
    ) -> None:
        super().__init__(engine, base)
        self._log, self._recorded = log, recorded
        self._changes = FactChanges(log)

    def thing(self, iri: NamedNode) -> Explanation:
        """Explanation of the presence or removal of a thing.

        Raises QueryParameterError if the map never held it.
        """
        facts = [q for q in self._quads(iri) if q.graph_name not in BACKGROUND]
        if not facts:
            return self._background_or_removed(iri)
        types = [q for q in facts if q.predicate == v.RDF_TYPE]
        if NamedNode(v.DEPARTED_OBJECT) in (quad.object for quad in types):
            return self._departed(iri, types[0])
        # every place has these two types by construction
        trivial = NamedNode(v.PLACE), NamedNode(v.BOT_SPACE)
        sizes = self._size_reasons(facts)
        reasons = [
            replace(fact, because=(*sizes(q.object), *fact.because))
            for q in types
            if q.object not in trivial and (fact := self.fact(q))
        ]
        reasons += [
            self.fact(q) for q in facts if q.graph_name == v.ASSERTIONS_GRAPH and q not in types
        ]
        reasons += self._alternatives(facts)
        if not any(step.kind == "observation" for r in reasons for _, step in r.walk()):
            reasons += self._observation(iri)
        if not reasons:
            reasons = [self.fact(q) for q in facts]
        for prop in ("label", "existence", "position", "note"):
            if (node := self._assertion(iri, prop)) is not None:
                reasons.append(self._asserted(node, prop))
        return Explanation(
            *("thing", self._name(iri, facts), iri.value),
            (*reasons, *self._last(facts)),
        )

    def _alternatives(self, facts: list[Quad]) -> Iterator[Explanation]:
        """Alternative categories of an object."""
        nodes = [q.object for q in facts if q.predicate.value == v.HAS_LABEL_BELIEF]
        likely = {n: self._text(n, v.LABEL_PROBABILITY) for n in nodes if isinstance(n, NamedNode)}
        sizes = self._size_reasons(facts)
        for node in sorted(likely, key=lambda n: (likely[n], n.value), reverse=True):
            other = self._called(node, v.OF_CATEGORY)
            text = f"may also be {other} ({self._share(node, v.LABEL_PROBABILITY)})"
            rule = Explanation("rule", known.RULES[v.LABEL_PROBABILITY])
            size = [r for category in self._values(node, v.OF_CATEGORY) for r in sizes(category)]
            yield Explanation("belief", text, node.value, (*size, rule))

    def _size_reasons(self, facts: list[Quad]) -> Callable[[Term], list[Explanation]]:
        """Callable: category -> how the sides of a thing with these `facts` speak for it or not."""
        known_texts = self._texts(facts)
        sides = [
            float(known_texts[p]) for p in (v.EXTENT_X, v.EXTENT_Y, v.EXTENT_Z) if p in known_texts
        ]

        def reasons(category: Term) -> list[Explanation]:
            if len(sides) < 3 or not isinstance(category, NamedNode):
                return []
            found = self._values(category, v.RDFS_LABEL)
            labels = [one.value for one in found if isinstance(one, Literal)]
            texts = (size_reason(label, sorted(sides, reverse=True)) for label in labels)
            return [Explanation("rule", text) for text in texts if text][:1]

        return reasons

    def facts(
        self, subject: NamedNode, predicate: NamedNode, value: Term | None
    ) -> tuple[Explanation, ...]:
        """Explanation of each such fact, with any object if `value` is None.

        Raises QueryParameterError if the map never held one.
        """
        present = [q for q in self._quads(subject) if q.predicate == predicate]
        matching = [q for q in present if value is None or same(q.object, value)]
        if matching:
            return tuple(map(self.fact, matching))
        return self._inferred(subject, predicate, value, present) or (
            self._was(subject, predicate, value, present),
        )

    def _inferred(
        self, subject: NamedNode, predicate: NamedNode, value: Term | None, present: list[Quad]
    ) -> tuple[Explanation, ...]:
        """Explanation of an inferred type by the stated ones; empty for another fact."""
        quads = self._engine.quads_for_pattern(subject, predicate, None, v.INFERRED_GRAPH)
        rule = Explanation("rule", "inferred: a thing has the superclasses of its class, too")
        return tuple(
            replace(self.fact(quad), because=(rule, *map(self.fact, present)))
            for quad in quads
            if value is not None and same(quad.object, value)
        )

    def fact(self, quad: Quad) -> Explanation:
        """Explanation of a fact of the map."""
        triple = quad.subject, quad.predicate, quad.object
        return Explanation(
            "fact", self._names.fact(*triple), None, tuple(self._behind(quad)), triple
        )

    def _behind(self, quad: Quad) -> Iterator[Explanation]:
        if quad.graph_name in BACKGROUND:
            yield from self._ontology_reasons(quad)
            return
        sequence = self._changes.sequence_of(quad)
        commit = self._log.commit(sequence)
        mapped = commit is None or commit.cause.kind in ("frame", "recovery", "search")
        if commit is None and (assertion := self._assertion_behind(quad)):
            yield assertion
        elif mapped and quad.graph_name == v.MAP_GRAPH and isinstance(quad.subject, NamedNode):
            yield from self._mapped(quad.subject, quad.predicate.value, quad.object)
        yield self._commit(sequence)

    def _assertion_behind(self, quad: Quad) -> Explanation | None:
        """The assertion behind a fact whose transaction is not kept, or None."""
        prop = _ASSERTED_PROPERTIES.get(quad.predicate.value)
        subject = quad.subject if quad.graph_name == v.MAP_GRAPH else None
        if prop is None or not isinstance(subject, NamedNode):
            return None
        if (node := self._assertion(subject, prop)) is None:
            return None
        (value,) = self._values(node, v.ASSERTED_VALUE)
        if isinstance(value, NamedNode) and value != quad.object:
            return None
        return self._asserted(node, prop)

    def _asserted(self, node: NamedNode, prop: str) -> Explanation:
        """An assertion with its time and its author."""
        (value,) = self._values(node, v.ASSERTED_VALUE)
        when = iso(seconds(self._text(node, v.PROV_GENERATED_AT)))
        text = f"{prop} {self._names(value)}, asserted at {when}"
        agents = self._values(node, v.PROV_ATTRIBUTED_TO)
        people = tuple(
            Explanation("person", agent_name(self._base, agent.value), agent.value)
            for agent in agents
            if isinstance(agent, NamedNode)
        )
        return Explanation("fact", text, node.value, people)

    def _mapped(self, subject: NamedNode, predicate: str, value: Term) -> Iterator[Explanation]:
        """The mapper's rule for one of its facts, and the evidence for it."""
        kinds = {getattr(kind, "value", "") for kind in self._values(subject, v.RDF_TYPE.value)}
        rule = known.rule_of(predicate, kinds, self._in_surface(subject, kinds))
        if rule and not (v.PLACE_BELIEF in kinds and predicate == v.BELIEF):
            yield Explanation("rule", rule)
        if v.PLACE in kinds and predicate == v.RDF_TYPE.value:
            yield from self._belief(subject, value)
        if v.PLACE_BELIEF in kinds and predicate == v.BELIEF:
            yield from self._grounds(subject)
        if v.SOSA_OBSERVATION in kinds:
            yield from self._sighting(subject)
        elif predicate in known.EVIDENT:
            yield from self._observation(subject)

    def _ontology_reasons(self, quad: Quad) -> Iterator[Explanation]:
        """Reasons for a fact of the ontology: the relation with its source, or the ontology."""
        is_relation = quad.predicate.value in (v.LOCATED_AT, v.NEAR_BY)
        if is_relation and isinstance(quad.object, NamedNode):
            for node in self._engine.quads_for_pattern(None, _SUBJECT, quad.subject, None):
                relation = node.subject
                if (
                    isinstance(relation, NamedNode)
                    and quad.object in self._values(relation, v.RELATION_TARGET)
                    and quad.predicate.value.removeprefix(v.HERE) in relation.value
                ):
                    yield self._background_or_removed(relation)
            return
        sources = [*self._sources(quad.subject)]
        yield from sources or [Explanation("source", "the ontology", v.ONTOLOGY_GRAPH.value)]
        if self._changes.sequence_of(quad) > self._log.floor:
            yield self._commit(self._changes.sequence_of(quad))

    def _observation(self, thing: NamedNode) -> Iterator[Explanation]:
        for node in self._values(thing, v.EXPLAINED_BY):
            if isinstance(node, NamedNode):
                yield from self._sighting(node)

    def _sighting(self, node: NamedNode) -> Iterator[Explanation]:
        wanted = (v.FRAME, v.FROM_RECORDING, v.SOSA_RESULT_TIME, v.BOX, v.SCORE, v.MODEL)
        frame, recording, when, box, score, model = (self._called(node, name) for name in wanted)
        detected = model != SURFACE
        number = f"score {score}" if detected else f"share in the open {score}"
        text = f"seen best in {frame} of {recording} at {when}: box {box} px, {number}"
        behind = [Explanation("model", f"detector {model}")] if detected else []
        for quad in self._quads(node, v.FRAME)[:1]:
            sequence = self._changes.sequence_of(quad)
            behind += [*(self._pose(sequence) if detected else ()), self._commit(sequence)]
        yield Explanation("observation", text, node.value, tuple(behind))

    def _pose(self, sequence: int) -> Iterator[Explanation]:
        """Pose of the camera at the transaction `sequence`."""
        quads = state_of(self._log, self._base + "robot", sequence)
        texts = self._texts(quads)
        if v.X in texts and sequence > self._log.floor:
            where = ", ".join(texts.get(axis, "?") for axis in (v.X, v.Y, v.Z))
            text = f"camera at ({where}) m, heading {texts.get(v.HEADING, '?')} rad"
            yield Explanation("pose", text, self._base + "robot")

    def _belief(self, place: NamedNode, category: Term) -> Iterator[Explanation]:
        for node in self._values(place, v.HAS_BELIEF):
            if isinstance(node, NamedNode) and category in self._values(node, v.OF_CATEGORY):
                text = f"{self._names(category)} with {self._share(node, v.BELIEF)}"
                yield Explanation("belief", text, node.value, tuple(self._grounds(node)))

    def _grounds(self, node: NamedNode) -> Iterator[Explanation]:
        """Evidence for a belief of a place: views, and objects in the place if they count."""
        place = NamedNode(node.value.partition("/belief/")[0])
        evidence = [x for x in self._values(place, v.TOLD_BY) if isinstance(x, NamedNode)]
        yield Explanation("rule", known.BELIEF_OF_PLACE if evidence else known.RULES[v.BELIEF])
        if not evidence or self._values(place, v.VIEW_COUNT) != [Literal(0)]:
            yield self._views(place)
        if evidence:
            text = f"by the views alone {self._share(node, v.SCENE_BELIEF)}"
            yield Explanation("belief", text, node.value)
        for thing in evidence:
            text = f"{self._names(thing)}, existence {self._text(thing, v.EXISTENCE)}"
            yield Explanation("thing", text, thing.value, tuple(self._observation(thing)))

    def _views(self, place: NamedNode) -> Explanation:
        frames = self._changes.changes_of(place, v.VIEW_COUNT)
        count = self._text(place, v.VIEW_COUNT)
        latest = ", ".join(c.cause.note for c in frames[-MAX_VIEWS:] if c.cause.note)
        models = {
            self._text(NamedNode(quad.subject.value), v.SCENE_MODEL)
            for quad in self._engine.quads_for_pattern(None, NamedNode(v.SCENE_MODEL), None, None)
            if isinstance(quad.subject, NamedNode)
        }
        behind = tuple(Explanation("model", f"scene model {name}") for name in sorted(models))
        views = "view" if count == "1" else "views"
        text = f"{count} {views} of {self._names(place)}" + (f", last {latest}" * bool(latest))
        return Explanation("view", text, place.value, behind)

    def _background_or_removed(self, iri: NamedNode) -> Explanation:
        texts = self._texts(self._quads(iri))
        if v.RELATION_SUBJECT in texts:
            kind = short(iri, self._base).removeprefix(v.RELATION).partition("/")[0]
            one, other = (self._called(iri, p) for p in (v.RELATION_SUBJECT, v.RELATION_TARGET))
            verb = word(NamedNode(v.HERE + kind))
            text = f"{one} {verb} {other} with {self._share(iri, v.RELATION_PROBABILITY)}"
            return Explanation("relation", text, iri.value, tuple(self._sources(iri)))
        if texts:
            found = self._engine.quads_for_pattern(None, _SUBJECT, iri, BACKGROUND[1])
            relations = [
                self._background_or_removed(q.subject)
                for q in sorted(found, key=str)
                if isinstance(q.subject, NamedNode)
            ]
            source = Explanation("source", "the ontology", v.ONTOLOGY_GRAPH.value)
            return Explanation("thing", self._names(iri), iri.value, (source, *relations))
        removals = self._changes.changes_of(iri, v.RDF_TYPE.value, removed=True)
        if not removals:
            raise QueryParameterError(
                f"the map holds nothing about {short(iri, self._base)}, and never did in its "
                "recorded history; `hereabouts ask MAP objects` lists what there is"
            )
        last = removals[-1]
        before = state_of(self._log, iri.value, last.sequence - 1)
        unnamed = NamedNode(v.UNNAMED_THING) in (quad.object for quad in before)
        rule = Explanation("rule", known.REMOVAL_OF_UNNAMED if unnamed else known.REMOVAL)
        reasons = (rule,) if last.cause.kind in ("frame", "search") else ()
        text = f"{self._texts(before).get(v.RDFS_LABEL, self._names(iri))} is no longer in the map"
        return Explanation("was", text, iri.value, (*reasons, self._commit(last.sequence)))

    def _departed(self, iri: NamedNode, type_quad: Quad) -> Explanation:
        """Explanation of an object that left its position."""
        spot = ", ".join(self._text(iri, axis) for axis in (v.X, v.Y, v.Z))
        text = (
            f"{self._text(iri, v.RDFS_LABEL)} left ({spot}) m: last seen "
            f"{self._text(iri, v.LAST_SEEN)}, found gone {self._text(iri, v.FOUND_GONE)}"
        )
        commit = self._commit(self._changes.sequence_of(type_quad))
        return Explanation("was", text, iri.value, (Explanation("rule", known.REMOVAL), commit))

    def _was(
        self, subject: NamedNode, predicate: NamedNode, value: Term | None, present: list[Quad]
    ) -> Explanation:
        """Explanation of the removal of a fact; `present` are facts with the same predicate."""
        removals = self._changes.changes_of(subject, predicate.value, removed=True, value=value)
        text = self._names.fact(subject, predicate, value)
        if not removals:
            now = ", ".join(self._names(q.object) for q in present) or "nothing"
            raise QueryParameterError(
                f"the map does not hold {text}, and never did in its recorded history; "
                f"of that it holds: {now}"
            )
        commit = self._commit(removals[-1].sequence)
        return Explanation("was", f"{text}: no longer", subject.value, (commit,))

    def _last(self, facts: list[Quad]) -> Iterator[Explanation]:
        """The latest of the transactions behind `facts`, if there are several."""
        sequences = {self._changes.sequence_of(quad) for quad in facts}
        if len(sequences) > 1:
            yield replace(self._commit(max(sequences)), kind="change")

    def _commit(self, sequence: int) -> Explanation:
        commit = self._log.commit(sequence)
        iri = f"{self._base}commit/{sequence}"
        if commit is None:
            if not self._recorded:
                return Explanation("commit", "not known: this map keeps no history")
            when = iso(self._log.floor_time)
            text = f"since before the history begins (#{self._log.floor}, {when})"
            return Explanation("commit", text, iri, (), None, self._log.floor_time)
        cause = commit.cause
        note = f" ({self._names.text(cause.note)})" if cause.note else ""
        text = f"transaction #{sequence} at {iso(commit.time)}: {cause.kind}{note}"
        by = cause.by
        agents = (Explanation("person", by, agent_iri(self._base, by)),) if by else ()
        return Explanation("commit", text, iri, agents, None, commit.time)

    def _sources(self, subject: Term) -> Iterator[Explanation]:
        if isinstance(subject, NamedNode):
            for source in self._values(subject, v.DCT_SOURCE):
                iri = source.value if isinstance(source, NamedNode) else None
                yield Explanation("source", getattr(source, "value", str(source)), iri)


def explain_fact(
    engine: QuadStore, log: HistoryLog, base: str, what: str, *, recorded: bool = True
) -> tuple[Explanation, ...]:
    """Explanations of `what`: a thing (object/17), or facts ("object/17 here:inPlace")."""
    subject, predicate, value = statement(what, base)
    explainer = Explainer(engine, log, base, recorded=recorded)
    if predicate is None:
        return (explainer.thing(subject),)
    return explainer.facts(subject, predicate, value)
