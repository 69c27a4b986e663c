"""Several sources may speak of one relation; each keeps its own probability."""

import pyoxigraph
import pytest
from pyoxigraph import Literal, RdfFormat

from kg.knowledge.ontology.relations import CategoryRelation, mark_of, relations
from kg.model import vocabulary as v
from kg.model.errors import OntologyError

HEADER = f"@prefix here: <{v.HERE}> . @prefix owl: <{v.PREFIXES['owl']}> . "
STATED = "here:Cup here:locatedAt here:Kitchen . "


def axiom(probability: float, *more: str, marked: bool = False) -> str:
    body = [
        *("owl:annotatedSource here:Cup", "owl:annotatedProperty here:locatedAt"),
        *("owl:annotatedTarget here:Kitchen", f"here:probability {probability}e0", *more),
    ]
    if marked:
        text = f"{HEADER}[] {' ; '.join(body)} ."
        notes = pyoxigraph.parse(text, format=RdfFormat.TURTLE)
        body.append(f'here:importMark "{mark_of((q.predicate.value, q.object) for q in notes)}"')
    return f"[] a owl:Axiom ; {' ; '.join(body)} . "


def relation(*axioms: str) -> CategoryRelation:
    (found,) = relations(
        pyoxigraph.parse(HEADER + STATED + "".join(axioms), format=RdfFormat.TURTLE)
    )
    return found


def test_what_people_state_outranks_what_was_imported() -> None:
    found = relation(
        axiom(0.9, "here:weight 9e0", "here:weightAgainst 1e0", marked=True), axiom(0.3)
    )
    assert found.probability == 0.3
    assert [(e.stated, e.probability, e.weight, e.weight_against) for e in found.evidence] == [
        (True, 0.3, None, 0.0),
        (False, 0.9, 9.0, 1.0),
    ]


def test_among_imports_the_highest_counts_with_its_sources_only() -> None:
    source = "<http://purl.org/dc/terms/source>"
    low = axiom(0.2, f'{source} "low"', marked=True)
    high = axiom(0.4, f'{source} "high"', marked=True)
    also = axiom(0.4, f'{source} "also"', marked=True)
    found = relation(low, high, also)
    assert found.probability == 0.4
    assert found.sources == (Literal("also"), Literal("high"))
    assert [e.probability for e in found.evidence] == [0.4, 0.4, 0.2]


def test_an_import_edited_since_is_what_a_person_states() -> None:
    edited = axiom(0.9, marked=True).replace("0.9e0", "0.1e0")
    found = relation(edited, axiom(0.5, "here:weight 3e0", marked=True))
    assert found.probability == 0.1
    assert [e.stated for e in found.evidence] == [True, False]


def test_two_probabilities_of_people_are_still_refused() -> None:
    with pytest.raises(OntologyError, match=r"has 0\.2e0 and 0\.3e0"):
        relation(axiom(0.2), axiom(0.3))


@pytest.mark.parametrize("weight", ['"NaN"', "-1", '"much"'])
def test_a_weight_that_is_none_is_refused(weight: str) -> None:
    with pytest.raises(OntologyError, match="needs a here:weight that is a number"):
        relation(axiom(0.2, f"here:weight {weight}"))


def test_a_mark_looks_at_values_not_at_how_they_are_written() -> None:
    double = v.XSD_DOUBLE
    one = [(v.PROBABILITY, Literal("0.2e0", datatype=double)), (v.DCT_SOURCE, Literal("a"))]
    other = [(v.DCT_SOURCE, Literal("a")), (v.PROBABILITY, Literal("2.0E-1", datatype=double))]
    assert mark_of(one) == mark_of(other) != mark_of(one[:1])
