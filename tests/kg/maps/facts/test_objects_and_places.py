"""Records become facts and come back, as precise as the map is and no more."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Store

from kg.maps.facts.objects_and_places import RecordCodec
from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import Evidence, ObjectRecord, PlaceRecord, PlaceViews
from tests.shipped_ontology import CATALOGUE

BASE = "http://example.org/lab/"
FACTS = RecordCodec(BASE, CATALOGUE)
CATEGORIES = FACTS.catalogue.categories
THINGS = [category.iri for category in CATEGORIES if category.kind == "object"]
ROOMS = [category.iri for category in CATEGORIES if category.kind == "place"]

metres = st.floats(-1e4, 1e4)
shares = st.floats(0, 1)
stamps = st.floats(0, 4e9)
texts = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)
evidence = st.builds(
    Evidence,
    frame=texts,
    recording=texts,
    stamp=stamps,
    box=st.tuples(*[st.floats(0, 5000)] * 4),
    score=shares,
    model=texts,
)


@st.composite
def objects(draw: st.DrawFn) -> ObjectRecord:
    first, last = sorted((draw(stamps), draw(stamps)))
    return ObjectRecord(
        iri=f"{BASE}object/{draw(st.integers(1, 10**6))}",
        category=draw(st.sampled_from(THINGS)),
        p_map=np.array([draw(metres), draw(metres), draw(metres)]),
        confidence=draw(st.floats(0, 5)),
        existence=draw(shares),
        observations=draw(st.integers(1, 10**6)),
        first_seen=first,
        last_seen=last,
        place=draw(st.sampled_from([None, BASE + "place/1"])),
        evidence=draw(st.none() | evidence),
        extent=draw(st.none() | st.just(np.array([1.2, 0.8, 0.75]))),
        yaw=draw(st.floats(-math.pi, math.pi)),
    )


def stored(quads: list) -> Store:  # type: ignore[type-arg]
    store = Store()
    store.extend(quads)
    return store


@given(objects())
def test_an_object_comes_back_within_a_centimetre_a_hundredth_and_a_second(record):
    (back,) = FACTS.objects(stored(FACTS.of_object(record)))
    np.testing.assert_allclose(back.p_map, record.p_map, atol=0.00501)
    assert back.confidence == pytest.approx(record.confidence, abs=0.01)
    assert back.existence == pytest.approx(record.existence, abs=0.00501)
    assert back.first_seen == pytest.approx(record.first_seen, abs=0.501)
    assert back.last_seen == pytest.approx(record.last_seen, abs=0.501)
    same = ("iri", "category", "observations", "place")
    assert [getattr(back, n) for n in same] == [getattr(record, n) for n in same]
    assert (back.evidence is None) == (record.evidence is None)
    if back.evidence is not None and record.evidence is not None:
        names = ("frame", "recording", "model")
        assert [getattr(back.evidence, n) for n in names] == [
            getattr(record.evidence, n) for n in names
        ]
        assert back.evidence.box == pytest.approx(record.evidence.box, abs=0.501)


@given(objects())
def test_what_came_back_once_never_changes_again(record: ObjectRecord) -> None:
    quads = FACTS.of_object(record)
    (back,) = FACTS.objects(stored(quads))
    assert set(stored(FACTS.of_object(back))) == set(stored(quads))


@given(st.dictionaries(st.sampled_from(ROOMS), shares, max_size=5), st.integers(0, 100), metres)
def test_a_place_comes_back_with_the_beliefs_worth_keeping(beliefs, views, xmin):
    record = PlaceRecord(BASE + "place/1", "the lab", xmin, xmin + 3, 0, 2, views, beliefs)
    (back,) = FACTS.places(stored(FACTS.of_place(record)))
    kept = {category: belief for category, belief in beliefs.items() if belief >= 0.005}
    assert back.beliefs == pytest.approx(kept, abs=0.00501)
    assert (back.label, back.views) == ("the lab", views)
    assert (back.xmin, back.xmax) == pytest.approx((xmin, xmin + 3), abs=0.00501)


@pytest.mark.parametrize(
    "box", [(1.0, 2.0, 3.0), (1.0, 2.0, 3.0, 4.0, 5.0), (0.0, 0.0, math.nan, 4.0), (math.inf,) * 4]
)
def test_a_box_that_is_not_four_numbers_is_an_error(box: tuple[float, ...]) -> None:
    seen = Evidence("frame 1", "tour", 1.0, box, 0.5, "network")  # type: ignore[arg-type]
    with pytest.raises(InvalidFactError, match="box must be 4 finite numbers"):
        FACTS.of_object(replace(CHAIR, evidence=seen))


def test_views_of_a_place_come_back_and_must_be_shares() -> None:
    place = PlaceRecord(BASE + "place/1", "p", 0, 1, 0, 1)
    viewed = PlaceViews(share=0.75, close_share=0.25, last=1e9)
    (back,) = FACTS.places(stored(FACTS.of_place(replace(place, viewed=viewed))))
    assert back.viewed == viewed
    assert FACTS.places(stored(FACTS.of_place(place)))[0].viewed is None
    for share, close in ((0.5, 0.6), (1.1, 0.5), (0.5, -0.1)):
        with pytest.raises(InvalidFactError, match="between 0 and 1"):
            FACTS.of_place(replace(place, viewed=PlaceViews(share, close, 1e9)))


def test_a_place_is_of_its_top_category_only_once_viewed() -> None:
    kitchen, bar = (FACTS.catalogue.find(name, "place").iri for name in ("kitchen", "bar"))
    place = PlaceRecord(BASE + "place/1", "p", 0, 1, 0, 1, 0, {kitchen: 0.6, bar: 0.4})

    def types(record: PlaceRecord) -> set[str]:
        return {
            str(getattr(q.object, "value", ""))
            for q in FACTS.of_place(record)
            if q.predicate == v.RDF_TYPE and getattr(q.subject, "value", "") == record.iri
        }

    assert types(place) == {v.PLACE, v.BOT_SPACE}
    assert types(replace(place, views=1)) == {v.PLACE, v.BOT_SPACE, kitchen}


CHAIR = ObjectRecord(
    BASE + "object/1", FACTS.catalogue.find("chair").iri, np.zeros(3), 1.0, 0.5, 1, 0.0, 1.0
)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"p_map": np.array([0, math.nan, 0])}, "finite"),
        ({"p_map": np.array([0, 0, math.inf])}, "finite"),
        ({"p_map": np.zeros(2)}, r"shape \(3,\)"),
        ({"confidence": math.nan}, "finite"),
        ({"confidence": -1.0}, "within 0"),
        ({"existence": 1.5}, "0..1, got 1.5"),
        ({"observations": 0}, "must be 1 to"),
        ({"category": v.HERE + "Unicorn"}, "no category"),
        ({"first_seen": 9.0}, "not be after"),
        ({"last_seen": math.inf}, "seconds since 1970"),
        ({"last_seen": 1e18}, "seconds since 1970"),
        ({"place": "not an iri"}, "absolute IRI"),
    ],
)
def test_what_cannot_be_true_is_refused_in_one_line(change: dict[str, object], reason: str) -> None:
    with pytest.raises(InvalidFactError, match=reason) as caught:
        FACTS.of_object(replace(CHAIR, **change))  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_a_confidence_above_zero_stays_above_zero() -> None:
    (back,) = FACTS.objects(stored(FACTS.of_object(replace(CHAIR, confidence=5e-16))))
    assert back.confidence > 0


def test_an_upside_down_rectangle_is_refused() -> None:
    with pytest.raises(InvalidFactError, match="xmin < xmax"):
        FACTS.of_place(PlaceRecord(BASE + "place/1", "p", 2, 1, 0, 1))
