"""The benchmark of questions: scores, the answers of plain maps, and a small house through all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from kg.model.errors import GraphError
from kg.serving.opening import in_memory_map
from lab.questions.plain_map import PlainMap
from lab.questions.question_file import FAMILIES, HouseQuestion, load_questions, save_questions
from lab.questions.scoring import score

if TYPE_CHECKING:  # it imports pictures and agents, which collection need not wait for
    from lab.questions.house_drives import HouseFacts


def question(family: str, answer: Any, **more: Any) -> HouseQuestion:
    return HouseQuestion("1", "7", family, "?", more.pop("parameters", {}), answer, **more)


@pytest.mark.parametrize(
    ("asked", "given", "points"),
    [
        (question("count", 2), 2, 1.0),
        (question("count", 2), "2", 0.0),
        (question("count", 1), True, 0.0),
        (question("presence", False), False, 1.0),
        (question("presence", False), None, 0.0),
        (question("nearest", [1, 2, 0.5], tolerance=0.5), [1.3, 2.3], 1.0),
        (question("nearest", [1, 2, 0.5], tolerance=0.5), [1.4, 2.4, 0.5], 0.0),
        (question("last seen", 1000.0, tolerance=60.0), 1060.0, 1.0),
        (question("last seen", 1000.0, tolerance=60.0), "then", 0.0),
        (question("between", ["bed", "cup"]), ["cup"], 2 / 3),
        (question("between", []), [], 1.0),
        (question("between", ["cup"], ignore=["bed"]), ["bed", "cup"], 1.0),
        (question("between", ["cup"]), "cup", 0.0),
        (question("why", [["a", "f1"], ["a", "f2"]]), ["a", "f2"], 1.0),
        (question("why", [["a", "f1"]]), ["b", "f1"], 0.0),
        (question("plan", ["den", "hall"]), ["hall", "bath"], 1.0),
        (question("plan", ["den", "hall"]), ["bath", "hall", "den"], 0.0),
        (question("size", 2.0, tolerance=0.3), 2.2, 1.0),
        (question("size", 2.0, tolerance=0.3), 2.4, 0.0),
        (question("picture", [["a", "f1", 0, 0, 10, 10]]), ["a", "f1", 1, 0, 10, 11], 1.0),
        (question("picture", [["a", "f1", 0, 0, 10, 10]]), ["a", "f1", 5, 5, 15, 15], 0.0),
        (question("picture", [["a", "f1", 0, 0, 10, 10]]), ["a", "f2", 0, 0, 10, 10], 0.0),
        (question("picture", [["a", "f1", 0, 0, 10, 10]]), ["a", "f1"], 0.0),
        (question("unanswerable", "not known"), "not known", 1.0),
        (question("unanswerable", "not known"), 0, 0.0),
        (question("plan", ["den"]), [], 0.0),
    ],
)
def test_scores(asked: HouseQuestion, given: Any, points: float) -> None:
    assert score(asked, given) == pytest.approx(points)


def thing(number: int, category: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    seen = {"recording": "session-2", "frame": f"frame-{number:06d}", "box": [10, 20, 30, 40]}
    return {
        "name": f"object/{number}",
        "category": category,
        "position": [x, y, 0.5],
        "size": [0.3, 0.3, 0.3],
        "existence": 1.0,
        "last_seen": 1.7e9 + number,
        "seen_in": seen,
        "relations": [],
        **more,
    }


def room(number: int, label: str, kind: str, x: float, viewed: float, *things: Any) -> Any:
    outline = [[x, 0.0], [x + 4.0, 0.0], [x + 4.0, 4.0], [x, 4.0]]
    return {
        "name": f"place/{number}",
        "label": label,
        "likely_category": kind,
        "outline": [outline],
        "viewed_share": viewed,
        "objects": list(things),
    }


def flat(*, cup_at: float, vase: bool) -> dict[str, Any]:
    """A kitchen and a bedroom, and a closed study; the cup moves along x, the vase may leave."""
    on_bed = [{"kind": "on", "target": "object/4", "probability": 1.0}]
    kitchen = [thing(1, "oven", 0.5, 0.5), thing(2, "cup", cup_at, 2.0), thing(3, "sink", 3.5, 0.5)]
    kitchen += [thing(6, "vase", 3.5, 3.5)] if vase else []
    bedroom = [thing(4, "bed", 6.0, 2.0), thing(5, "book", 6.0, 2.3, relations=on_bed)]
    return {
        "rooms": [
            room(1, "kitchen", "kitchen", 0.0, 0.97, *kitchen),
            room(2, "bedroom", "bedroom", 4.0, 0.6, *bedroom),
            room(3, "study", "home office", 8.0, 0.0),
        ],
        "departed": [] if vase else [thing(6, "vase", 3.5, 3.5)],
    }


@pytest.fixture
def facts() -> HouseFacts:
    from lab.questions.house_drives import Doubtful, HouseFacts

    now = flat(cup_at=2.0, vase=False)
    return HouseFacts(
        number="7",
        before=flat(cup_at=1.0, vase=True),
        now=now,
        doubtful=[Doubtful(frozenset({"chair", "couch"}), 1.0, 3.0)],
        frames={one["name"]: [("session-2", one["seen_in"]["frame"])] for one in _all(now)},
        boxes={
            one["name"]: [("session-2", one["seen_in"]["frame"], (10, 20, 30, 40))]
            for one in _all(now)
        },
        rooms_with={"cup": {"kitchen"}, "keyboard": {"study"}, "chair": {"kitchen"}},
    )


def _all(document: dict[str, Any]) -> list[dict[str, Any]]:
    return [one for each in document["rooms"] for one in each["objects"]]


def test_plain_maps_answer_each_family(facts: HouseFacts) -> None:
    plain = PlainMap(facts.now, facts.before)
    assert (plain.count("cup"), plain.count_in_place("cup", "bedroom")) == (1, 0)
    assert plain.presence("oven", "kitchen") and not plain.presence("oven", "bedroom")
    assert plain.nearest("sink", "cup", "kitchen") == [3.5, 0.5, 0.5]
    assert plain.within_radius(1.0, "bed", "bedroom") == ["book"]
    assert plain.between("oven", "kitchen", "book", "bedroom") == ["bed"]
    assert plain.between("cup", "kitchen", "bed", "bedroom") == []
    assert plain.on_or_in("bed", "bedroom") == ["book"]
    assert plain.last_seen("vase") == 1.7e9 + 6
    assert (plain.moved_since(None), plain.moved_since("bedroom")) == (["cup"], [])
    status = [plain.never_looked("cup", r) for r in ("kitchen", "bedroom", "study")]
    assert status == ["present", "hidden", "never looked"]
    assert plain.never_looked("bed", "kitchen") == "looked, none seen"
    assert plain.never_looked("vase", "kitchen") == "gone"
    assert (plain.past("vase", "kitchen"), plain.past("vase", "bedroom")) == (1, 0)
    assert (plain.appeared_since(None), plain.vanished_since("kitchen")) == ([], ["vase"])
    assert plain.unanswerable("cup", "study") == "not known"
    assert (plain.unanswerable("cup", "kitchen"), plain.size("bed", "bedroom")) == (1, 0.3)
    assert plain.picture("bed", "bedroom") == ["session-2", "frame-000004", 10, 20, 30, 40]
    assert plain.why("cup", "kitchen") == ["session-2", "frame-000002"]
    assert plain.plan("cup") == ["kitchen", "study", "bedroom"]
    assert plain.why("cup", "study") is None and plain.nearest("cup", "cup", "study") is None


def test_the_same_seed_asks_the_same_and_nothing_that_is_doubtful(facts: HouseFacts) -> None:
    from lab.questions.generator import questions_of

    asked = questions_of(facts, 4)
    assert asked == questions_of(facts, 4)
    families = {one.family for one in asked}
    assert families >= FAMILIES.keys() - {"nearest", "between", "appeared since", "size"}
    for one in asked:
        assert one.parameters.get("category") not in ("chair", "couch") or (
            one.parameters.get("room") in ("bedroom", "study")
        )
    (known,) = [one for one in asked if one.text == "When was a vase last seen in the house?"]
    assert known.answer == 1.7e9 + 6
    plain = PlainMap(facts.now, facts.before)
    for one in asked:
        if one.family != "plan":
            given = getattr(plain, one.family.replace(" ", "_"))(**one.parameters)
            assert score(one, given) == 1.0, one


def test_every_interface_answers_a_true_map_rightly(facts: HouseFacts) -> None:
    from lab.questions.asking import INTERFACES, ask, differing
    from lab.questions.generator import questions_of
    from lab.questions.graph_maps import true

    asked, of_truth = questions_of(facts, 1), true(facts.before, facts.now)
    with of_truth.semantic_map:
        found = ask("true", of_truth, asked)
    assert {one.interface for one in found} == {*INTERFACES, "JSON"}
    assert differing(found) == []
    assert [one for one in found if one.score < 1.0 and one.question.family != "plan"] == []


def test_without_a_map_the_other_houses_answers_are_given(facts: HouseFacts) -> None:
    from lab.questions.blind import BlindAnswers
    from lab.questions.generator import questions_of

    cup = {"category": "cup"}
    others = [
        HouseQuestion(str(n), house, "count", "?", cup, answer)
        for n, (house, answer) in enumerate([("1", 3), ("2", 3), ("3", 5), ("7", 9)])
    ]
    with in_memory_map() as nothing:
        blind = BlindAnswers([*others, *questions_of(facts, 3)], nothing)
        assert blind.answer(others[3]) == 3
        plan = question("plan", ["kitchen"], parameters={"category": "refrigerator"})
        assert blind.answer(plan)[0] == "kitchen"


def test_answers_of_others_are_scored_from_files(tmp_path: Path, facts, prints, fails) -> None:
    from lab.questions.generator import questions_of

    asked = questions_of(facts, 3)
    save_questions(tmp_path, asked, {"7": {}})
    assert load_questions(tmp_path) == [*map(_as_read, asked)]
    (tmp_path / "7.json").write_text(json.dumps(facts.now))
    (tmp_path / "7-before.json").write_text(json.dumps(facts.before))
    answers = prints("lab.questions", "answer", tmp_path, tmp_path)
    (tmp_path / "answers.json").write_text(answers)
    table = prints("lab.questions", "score", tmp_path, tmp_path / "answers.json")
    assert "| count | 3 | 1.00 |" in table and "| never looked | 3 | 1.00 |" in table
    (tmp_path / "7.json").write_text('{"rooms": [{"objects": []}]}')
    assert "no plain map" in fails("lab.questions", "answer", tmp_path, tmp_path)
    assert "cannot read" in fails("lab.questions", "score", tmp_path / "none", tmp_path)
    with pytest.raises(GraphError, match="no plain map"):
        PlainMap({"rooms": [{"label": "x", "objects": [{"name": "a", "category": "cup"}]}]})


def _as_read(one: HouseQuestion) -> HouseQuestion:
    return HouseQuestion(**json.loads(json.dumps(_fields(one))))


def _fields(one: HouseQuestion) -> dict[str, Any]:
    return {name: getattr(one, name) for name in one.__dataclass_fields__}
