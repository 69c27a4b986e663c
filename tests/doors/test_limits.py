"""A limit of what a map holds stands at every door by which it is written."""

import pytest

from kg.model.errors import InvalidFactError, QueryRefusedError
from tests.doors.doors import READING, UPDATING, House, RefusedError
from tests.doors.stating_doors import ASSERTING, learn_remotely

#: updates beyond a limit, and what the refusal says
BEYOND = {
    "the number of an object": (
        f"INSERT DATA {{ <object/{'9' * 5000}> a here:Cup ; here:x 1.0 ; here:y 1.0 }}",
        "15 digits",
    ),
    "the number of an object, of 64 bits": (
        f"INSERT DATA {{ <object/{'9' * 19}> a here:Cup ; here:x 1.0 ; here:y 1.0 }}",
        "15 digits",
    ),
    "a label": (f"INSERT DATA {{ <object/1> rdfs:label '{'x' * 501}' }}", "501 characters"),
    "a label of two lines": (
        r"INSERT DATA { <object/1> rdfs:label 'cup\nby the sink' }",
        "one line",
    ),
    "a label that hides": ("INSERT DATA { <object/1> rdfs:label 'cup\u202e' }", "visible"),
    "the id of another as a label": ("INSERT DATA { <place/1> rdfs:label 'place/2' }", "is the id"),
    "an empty label": ("INSERT DATA { <object/1> rdfs:label ' ' }", "one character"),
    "a text": (f"INSERT DATA {{ <object/1> rdfs:comment '{'x' * 100_001}' }}", "100,001"),
    "an IRI": (f"INSERT DATA {{ <object/1> rdfs:seeAlso <urn:{'x' * 8000}> }}", "8,004"),
    "the side of a thing, in millimetres": (
        "DELETE { <object/2> here:extentX ?x } INSERT { <object/2> here:extentX 120e0 } "
        "WHERE { OPTIONAL { <object/2> here:extentX ?x } }",
        "millimetres",
    ),
    "the deviation of a position": (
        "INSERT DATA { <object/2> here:positionDeviation 1e200 }",
        "a double from 0 to 1e6 m",
    ),
    "a count": (
        "DELETE { <object/2> here:observationCount ?n } INSERT { <object/2> here:observationCount "
        "1000000000000000000 } WHERE { <object/2> here:observationCount ?n }",
        "an integer of 1 to",
    ),
    "the name of a thing": (
        f"INSERT DATA {{ <urn:{'x' * 8000}> rdfs:comment 'x' }}",
        "8,004 characters",
    ),
}


@pytest.mark.parametrize("door", UPDATING)
@pytest.mark.parametrize("what", BEYOND)
def test_an_update_beyond_a_limit_is_refused(house: House, door: str, what: str) -> None:
    text, message = BEYOND[what]
    before = house.map.sequence
    with pytest.raises(RefusedError, match=message):
        UPDATING[door](house, text)
    assert house.map.sequence == before


@pytest.mark.parametrize("door", ASSERTING)
def test_an_asserted_label_beyond_the_limit_is_refused(house: House, door: str) -> None:
    before = house.map.sequence
    with pytest.raises(RefusedError, match="characters"):
        ASSERTING[door](house, "object/1", "label", "x" * 501)
    assert house.map.sequence == before


@pytest.mark.parametrize("door", ASSERTING)
@pytest.mark.parametrize("prop", ["position", "extent"])
def test_millimetres_are_refused(house: House, door: str, prop: str) -> None:
    before = house.map.sequence
    with pytest.raises(RefusedError, match="are these millimetres"):
        ASSERTING[door](house, "object/2", prop, "1200 400 750")
    assert house.map.sequence == before


LEARNING = {
    "python": lambda house, labels: house.map.ontology.learn(labels, "object", model="net"),
    "labels": learn_remotely,
}


@pytest.mark.parametrize("door", LEARNING)
def test_the_labels_of_a_network_have_one_limit(house: House, door: str) -> None:
    before = house.map.sequence
    with pytest.raises(InvalidFactError, match="up to 50,000 labels, got 50,001"):
        LEARNING[door](house, [f"gizmo {number}" for number in range(50_001)])
    assert house.map.sequence == before
    long = f"{door} gizmo {'x' * 600}"
    (learnt,) = LEARNING[door](house, [long]).values()
    found = house.map.catalogue.by_iri(learnt)
    assert found is not None and found.label == long[:200]


#: patterns that no reader may ask, and what the refusal says
TOO_MUCH = {
    "brackets": (f"?thing here:x ?x FILTER({'(' * 150}?x > 0{')' * 150})", "nest"),
    "other sources": ("SERVICE <http://localhost:9/> { ?thing here:x ?x }", "SERVICE is refused"),
}
#: doors whose client parses the pattern, or hides the refusal; both are /sparql
CLIENTS = ("service", "SPARQLStore")


@pytest.mark.parametrize("door", [door for door in READING if door not in CLIENTS])
@pytest.mark.parametrize("what", TOO_MUCH)
def test_a_query_beyond_a_limit_is_refused(house: House, door: str, what: str) -> None:
    pattern, message = TOO_MUCH[what]
    with pytest.raises((RefusedError, QueryRefusedError), match=message):
        READING[door](house, pattern)
