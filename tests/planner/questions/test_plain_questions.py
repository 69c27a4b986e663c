"""Plain questions: their meaning, answers on a small flat, and texts that are no question."""

import json
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path

import pytest

from benchmarks.plain_questions.__main__ import PARTS, scored
from hereabouts.cli import main
from kg.history.timestamps import moment, spoken
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HereaboutsError, UnknownCategoryError, UnknownQueryError
from kg.model.records import MapUpdate, PlaceRecord
from kg.serving.opening import in_memory_map, open_map
from planner.questions.answers import answer_box, answer_question
from planner.questions.moments import past, since
from tests.planner.flat import fill, flat_map, thing

Says = Callable[..., str]


@pytest.fixture(scope="module")
def shared_flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flat that no test changes."""
    return flat_map(tmp_path_factory.mktemp("shared") / "flat.map")


@pytest.fixture(scope="module")
def opened(shared_flat: Path) -> Iterator[SemanticMap]:
    with open_map(shared_flat, read_only=True) as semantic_map:
        yield semantic_map


def told(semantic_map: SemanticMap, question: str) -> str:
    """The answer as it is printed, or why there is none."""
    try:
        return "\n".join(answer_question(semantic_map, question).lines)
    except HereaboutsError as error:
        return f"error: {error}"


@pytest.fixture
def flat(shared_flat: Path, tmp_path: Path) -> Path:
    return shutil.copytree(shared_flat, tmp_path / "flat.map")


def _run(capsys: pytest.CaptureFixture[str], path: Path, command: str, *words: str) -> str:
    capsys.readouterr()
    code = main([command, str(path), *words])
    out, err = capsys.readouterr()
    return out if code == 0 else f"exit {code}: {err}"


@pytest.fixture
def says(capsys: pytest.CaptureFixture[str], flat: Path) -> Says:
    """Callable: run a command on the flat; returns stdout, or stderr if it fails."""
    return partial(_run, capsys, flat)


@pytest.fixture
def answers(capsys: pytest.CaptureFixture[str], shared_flat: Path) -> Says:
    """Callable: as `says`, for commands that change nothing."""
    return partial(_run, capsys, shared_flat)


@pytest.mark.parametrize("part", PARTS, ids=lambda path: path.stem)
def test_most_questions_are_right_and_none_is_wrong(part: Path) -> None:
    verdicts = Counter(verdict for _, verdict, _ in scored(part))
    assert verdicts["right"] >= 0.8 * verdicts.total() and verdicts["wrong"] == 0
    assert verdicts.total() >= 40


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("Where is the cup?", "Probably no longer in the kitchen: cup 2 was seen there"),
        ("cup 2", "Probably no longer in the kitchen: cup 2 was seen there 4 times"),
        ("the red cup", "The map does not keep what is red, so this is about all of them"),
        ("what is in the kitchen", "2 objects in the kitchen: a banana, a cup"),
        ("are there exactly two cups", "1 cup"),
        ("is there a banana", "It was there, and has probably been moved since:"),
        ("is there a free cup", "The map does not keep what is free, so this is about all of"),
        ("how many places are there", " places: "),
        ("is the cup in the bedroom?", "Unknown: the robot viewed 0 % of the bedroom"),
        ("is cup 2 in the bedroom?", "No: cup 2 is in the kitchen"),
        ("how many giraffes", "0 giraffes"),
        ("is there a cup near the banana?", "No cup is known within 2 m of banana"),
        ("something to sit on", "bed 3 was seen there"),
        ("I am tired. Where might I lie down for a while?", "bed 3 was seen there"),
        ("I looked in the kitchen, where else is the cup?", "error: not understood"),
        ("where's cup two", "cup 2 was seen there"),
        ("what can I see from the bed?", "error: not understood"),
        ("which rooms don't you know?", "Never viewed: "),
        ("where was the cup before?", "cup is known to have moved"),
        ("wo stand die Tasse fr\u00fcher", "cup is known to have moved"),
        ("point me to the bedroom", "to the bedroom: "),
        ("is there a cup nearby?", "from the robot"),
        ("which cup is closest to me", "cup 2 in the kitchen is "),
        ("how certain are you about the kitchen?", "The kitchen is believed to be a kitchen"),
        ("what changed since yesterday evening", "Appeared: banana 1, cup 2, bed 3"),
        ("how many seats are there", "0 seats"),
        ("what is next to the cup", "Within 2 m of cup 2: nothing"),
        ("what is on the bed", "Nothing is known to be on or in bed 3"),
        ("which room did you see the bed in", "bed 3 was seen there"),
        ("what size is the bed?", "bed 3"),
        ("where is the second cup", "error: not understood"),
        ("are there two chairs and a cup", "error: not understood"),
        ("water bottle", "'water bottle' means bottle"),
        ("bring me the cup", "error: not understood: this answers questions and moves no"),
        ("what did you see last in the bowl", "error: last sightings are listed by place"),
        ("where can I sit in the kitchen?", "Nothing to sit on is known to be in the kitchen"),
        ("wie weit ist das Bett von der Tasse?", " m from cup 2"),
        ("when did you last see the cup?", f"years ago ({spoken(0.0)}) in the kitchen"),
        ("which rooms are there", "3 places: kitchen, bedroom, place 3"),
        ("list all objects", "3 objects: a banana, a cup, a bed"),
        ("where are you?", "The robot is in the bedroom at (6.0, 1.0), as of "),
        ("what is missing?", "Nothing is known to be gone"),
        ("what changed since yesterday", "Appeared: banana 1, cup 2, bed 3"),
        ("where are my keys?", "No detector here can see things called 'keys'. They are usually"),
        ("Wo ist die Tasse?", "'tasse' means cup\nProbably no longer in the kitchen: cup 2"),
        ("gibt es eine Banane in der K\u00fcche?", "It was there, and has probably been moved"),
        ("ist das Bett im Schlafzimmer", "It was there, and has probably been moved since:"),
        ("wie viele Tassen sind in der K\u00fcche", "1 cup in the kitchen"),
        ("is there a cup on the bed", "No cup is known to be on bed 3\nProbably no longer"),
        ("how many cups are on the bed?", "0 cups on bed 3"),
        ("which cup is closest to the banana", "The nearest is 2.8 m away: cup 2"),
        ("how far is the bed from the cup?", "bed 3 in the bedroom is 4.1 m from cup 2"),
        ("how far is the cup from the kitchen", "From the kitchen to cup 2: 1.4 m, in the same"),
        (
            "are all the beds in the kitchen?",
            "No: 0 of 1 beds are in the kitchen\nProbably no longer",
        ),
        ("Sind alle Betten im Schlafzimmer", "Yes: 1 of 1 beds are in the bedroom"),
        ("is there more than one cup", "No: 1 cup"),
        ("at least three cups in the kitchen?", "No: 1 cup in the kitchen"),
        ("since when has the cup been in the kitchen", "It was first seen "),
        ("when was the cup last in the bedroom", "No cup is known to be in the bedroom"),
        ("how large is the flat", "The 3 places of the map have "),
        ("how often did you see the bed", "bed 3 in the bedroom was seen "),
        ("is there anything new in the kitchen", "Appeared: banana 1, cup 2"),
        ("how big is the kitchen", "The kitchen has 16.0 m2, and is 4.0 x 4.0 m at its widest"),
        ("how tall is the bed", "The size of bed 3 is not known"),
        ("where are the cup and the bed?", "cup 2 was seen there 4 times"),
        ("where are the cup and the bed?", "bed 3 was seen there 4 times"),
        ("where is my cup and my keys", "No detector here can see things called 'keys'"),
        ("was there ever a cup?", "cup 2 was last seen 5"),
        ("wher is teh banana", "This is read as 'where is the banana'"),
        ("is there a second cup", "No: 1 cup"),
        ("is the bed still near the cup?", "No: no bed is known within 2 m of"),
        ("where was the cup yesterday?", "the map knows nothing of that time"),
        ("where am I?", "The map knows where the robot is, not where you are\nThe robot is in the"),
        ("Danke", "is there a cup in the kitchen?"),
        ("has anyone moved the cup?", "No cup is known to have moved or gone since today at "),
        ("what animals are there?", "No animal is in the map, but nobody looked: the robot viewed"),
        ("which cups are in the kitchen", "Probably no longer in the kitchen: cup 2"),
        ("where is the cup in the bedroom", "No cup is known to be in the bedroom\nProbably"),
        ("which room has the most cups?", "Most are in the kitchen: 1 of 1"),
        ("where can I find the most", "error: not understood"),
        ("which room has the most things", "Most are in the kitchen: 2 of 3\nOthers: 1 in the bed"),
        ("where is the doggy", "'doggy' is a kind of dog"),
        ("gibt es im Schlafzimmer ein Bett?", "It was there, and has probably been moved since:"),
        ("welche Tiere gibt es", "'tiere' means animal\nNo animal is in the map"),
        ("wo sind meine Schl\u00fcssel", "see things called 'schl\u00fcssel' (keys)"),
        ("what changed in the kitchen?", ":\nAppeared: banana 1, cup 2\nNew rooms: kitchen"),
        ("are there two cups?", "No: 1 cup"),
        ("do we have two bedrooms", "No: 1 bedroom: the bedroom"),
        ("are there 2 rooms?", "Yes: 3 rooms: the kitchen"),
        ("what was the last thing you saw?", "years ago: banana 1 in the kitchen\n"),
        ("what did you see last in the bedroom", "years ago: bed 3 in the bedroom"),
        ("which room is the largest?", "The largest is the kitchen (16.0 m2); then the bedroom"),
        ("how do I get to the kitchen?", "From the robot to the kitchen: "),
        ("what is between the cup and the bed?", "From cup 2 to bed 3: nothing is known to be"),
        ("how sure are you that there is a cup?", "sure that it exists, and "),
        ("how sure are you that the cup is in the bedroom", "No cup is known to be in the bedroom"),
        ("which rooms have you never been in?", "Never viewed: "),
        ("why do you think there is a cup?", "cup 2 has no observation in the map"),
        (
            "Do you know if there is a cup in the kitchen",
            "It was there, and has probably been moved",
        ),
        ("mum wants to know where her cup went", "cup 2 was seen there 4 times"),
        ("the cup, where is it?", "cup 2 was seen there 4 times"),
        ("has anybody seen the cup", "cup 2 was seen there 4 times"),
        ("in which room would I find the cup", "cup 2 was seen there 4 times"),
        ("where could I have put the cup?", "cup 2 was seen there 4 times"),
        ("what happened to the cup", "cup 2 was seen there 4 times"),
        ("Wann hast du zuletzt die Tasse gesehen", "cup 2 was last seen 5"),
        ("wo is denn mein Bett", "bed 3 was seen there 4 times"),
        ("is there only one bed", "1 bed"),
        (
            "give me a list of everything in the kitchen",
            "2 objects in the kitchen: a banana, a cup",
        ),
        ("anything on the bed?", "Nothing is known to be on or in bed 3"),
        (
            "what are the odds that the cup is still in the kitchen",
            "that it is still there",
        ),
        ("last time you saw the cup", "in the kitchen\nIt was first seen "),
        ("which rooms do I pass on my way to the kitchen", "From the robot to the kitchen: "),
        ("where haven't you been", "Never viewed: "),
        ("where's my can opener", "No detector here can see things called 'can opener'"),
    ],
)
def test_a_question_has_its_answer(opened: SemanticMap, question: str, answer: str) -> None:
    assert answer in told(opened, question)


def test_a_thing_seen_just_now_is_there() -> None:
    with in_memory_map() as semantic_map:
        fill(semantic_map)
        (seen,) = [one for one in semantic_map.objects() if one.category.endswith("Banana")]
        (line,) = answer_question(semantic_map, "is there a banana", seen.last_seen + 5).lines
        assert line.startswith("Yes, probably in the kitchen: banana 1 was seen there")


def test_a_place_that_is_called_house_is_no_whole_house() -> None:
    with in_memory_map() as semantic_map:
        house, shed = (
            PlaceRecord(semantic_map.place_iri(n), label, 4.0 * n, 4.0 * n + 4, 0, 3, 5)
            for n, label in enumerate(("House", "Shed"))
        )
        semantic_map.apply(MapUpdate(places=(house, shed)))
        semantic_map.apply(MapUpdate(objects=(thing(semantic_map, "cup", 5.0, 1.0, 1),)))
        assert told(semantic_map, "how many cups are in house?") == "0 cups in House"
        assert told(semantic_map, "how many cups are in the flat?") == "1 cup"


def test_doubted_things_are_listed_where_none_is_present() -> None:
    with in_memory_map() as semantic_map:
        fill(semantic_map)
        doubted = replace(thing(semantic_map, "vase", 3.5, 3.5, 1), existence=0.1)
        semantic_map.apply(MapUpdate(objects=(doubted,)))
        first, second = answer_question(semantic_map, "is there a vase?").lines
        assert first.startswith("Unknown: the robot viewed")
        vase = "Probably no longer in the kitchen: vase 4, which is probably no vase, was"
        assert second.startswith(vase)
        (elsewhere,) = answer_question(semantic_map, "is there a vase in the bedroom?").lines
        assert elsewhere.startswith("Unknown: ")


def test_json_has_the_query_that_has_the_facts(answers: Says) -> None:
    told = json.loads(answers("ask", "what is in the kitchen?", "--json"))
    assert (told["query"], told["parameters"]) == ("objects-in-place", {"place": "place 1"})
    assert [row["label"] for row in told["rows"]] == ["banana 1", "cup 2"]
    assert " objects-in-place -p place='place 1'" in answers(
        "ask", "what is in the kitchen?", "--format", "csv"
    )


@pytest.mark.parametrize(
    ("text", "says_so"),
    [
        ("", "not understood: an empty text"),
        ("where " * 2000, "questions of at most 300 characters that are: "),
        ("<script>alert('cup')</script> <b>?</b>", "not understood: "),
        ("who ate my cake?", "where is the banana?"),
        ("which room has the fewest cups", "not understood"),
        ("where is the pepsi", "no category 'pepsi'"),
        ("is there a cup that is not red", "not understood"),
        ("are there more chairs than cups", "not understood"),
        ("clean the bed", "not understood"),
        ("where is the cup and what is on the bed", "not understood"),
        ("is there a cup on the moon", "no category 'moon'"),
        ("is the cup on the floor", "no detector here can see floor, so nothing is known to be on"),
        ("what is there besides the bed", "not understood"),
        ("are there around five cups", "not understood"),
        ("are the cup and the bed in the same room", "not understood"),
        ("is the cup near the kitchen", "'kitchen' is a place; 'what is in the kitchen'"),
        ("how far is the cup from the cellar", "no place is called 'cellar'"),
        ("how many cups were in the kitchen a week ago", "the map knows nothing of that time"),
        ("gibt es keine Tasse", "not understood"),
        ("where is the bananna", "nothing is called 'bananna'; did you mean banana?"),
        ("hol mir die Tasse", "moves no robot; ask where die tasse is"),
        ("what changed in the bed?", "changes are listed by place, and 'bed' is none"),
        ("how do I get to the cellar", "no place is called 'cellar'; there are: place 1"),
        ("stell die Tasse in die K\u00fcche", "not understood"),
        ("is there a book about cups", "no category 'book about cups'"),
        ("where is the qwertzy", "no category"),
        ("where is cup 99", "nothing has the label 'cup 99'; there are: cup 2"),
        ("is chair 7 in the kitchen", "'chair 7'; no chair is in the map"),
        ("what changed since the flood", "today, yesterday at 9:30, an hour ago"),
    ],
)
def test_what_is_not_understood_is_one_line(opened: SemanticMap, text: str, says_so: str) -> None:
    line = told(opened, text)
    assert line.startswith("error: ")
    assert says_so in line
    assert "\n" not in line and len(line) < 1000


def test_sparql_and_names_of_queries_are_what_they_were(answers: Says) -> None:
    for text, says_so in (
        ("SELECT ?x WHERE { ?x a here:Cup", "does not parse at line 1"),
        ("placesof", "no query 'placesof'"),
        ("", "not understood: an empty text"),
    ):
        refused = answers("ask", text)
        assert refused.startswith("exit 1: error: ") and says_so in refused
        assert refused.count("\n") == 1
    assert "cup 2" in answers("ask", "objects")
    assert "0.90" in answers("ask", "SELECT ?e WHERE { ?o a here:Cup ; here:existence ?e }")


def test_what_changed_counts_from_where_the_kept_history_begins(says: Says, flat: Path) -> None:
    with open_map(flat) as semantic_map:
        semantic_map.history.compact(keep=0.0)
    assert says("assert", "cup 2", "category", "bowl", "--by", "ann") == ""
    assert "Relabelled: bowl 2" in says("ask", "what changed since yesterday")


def test_the_box_of_the_page_takes_questions(flat: Path) -> None:
    with open_map(flat, read_only=True) as semantic_map:
        for text in ("bring me the cup", "put the cup on the bed", "where is the bananna"):
            with pytest.raises((UnknownQueryError, UnknownCategoryError)) as refused:
                answer_question(semantic_map, text)
            with pytest.raises(refused.type, match=f"^{re.escape(str(refused.value))}$"):
                answer_box(semantic_map, [text])
        rooms = answer_box(semantic_map, ["how many cups are there?"])
        assert (rooms["answer"], rooms["steps"]) == (["1 cup"], [])
        found = answer_box(semantic_map, ["where is the blue cup?"])
        assert found["steps"] and found["known"]
        assert str(found["answer"]).startswith("['The map does not keep what is blue")
        assert answer_box(semantic_map, ["cup", "bed"])["targets"] == ["cup", "bed"]
        then = answer_question(semantic_map, "where is the cup?", now=60.0)
        assert then.lines[0].startswith("Probably in the kitchen: cup 2 was seen there 4")


@pytest.mark.parametrize(
    ("question", "names"),
    [
        ("where is the cup?", ["cup 2", "kitchen"]),
        ("how many cups are there?", ["object/2"]),
        ("what is in the kitchen?", ["kitchen", "object/2"]),
        ("which rooms are there?", ["kitchen", "bedroom"]),
        ("when was the cup last seen?", ["cup 2", "kitchen"]),
    ],
)
def test_an_answer_says_which_things_it_is_about(flat, question, names):
    with open_map(flat, read_only=True) as semantic_map:
        about = answer_box(semantic_map, [question])["about"]
        assert isinstance(about, list)
        told = [one["name"] or one["iri"].removeprefix(semantic_map.base) for one in about]
        assert [name for name in names if name not in told] == []
        assert len({one["iri"] for one in about}) == len(about)


def test_a_moment_of_the_past_has_the_answer_of_then(flat: Path) -> None:
    with open_map(flat) as semantic_map:
        asked = "where was the cup a minute ago?"
        *_, newest = semantic_map.history.events(f"{semantic_map.base}object/2")
        semantic_map.apply(MapUpdate(removed=(f"{semantic_map.base}object/2",)))
        then = answer_question(semantic_map, asked, newest.time + 60.0)
        assert then.lines[0].startswith("As the map was today at ")
        assert "cup 2 was seen there 4 times" in then.lines[1]
        later = answer_question(semantic_map, asked, newest.time + 3600.0)
        assert later.lines[1].startswith("No cup is in the map")


def test_days_begin_at_midnight_and_spans_count_back_from_now() -> None:
    noon = datetime(2026, 11, 24, 12, 0, 0, 500).timestamp()  # a Tuesday
    for words, day in (("today", 24), ("yesterday", 23), ("since sunday", 22), ("tuesday", 17)):
        begun = datetime.fromisoformat(since(words, noon)).timestamp()
        assert begun == datetime(2026, 11, day).timestamp()
    for words, seconds in (("in the last hour", 3600), ("over the past week", 604800)):
        assert moment(since(words, 1e9)) == pytest.approx(1e9 - seconds)
    for words, day, hour in (("9:30", 24, 9.5), ("sunday at 5 pm", 22, 17), ("13:00", 23, 13)):
        begun = datetime(2026, 11, day).timestamp()  # 13:00 was yesterday
        assert past(words, noon) == pytest.approx(begun + 3600.0 * hour)
    midnight = datetime(2026, 11, 23).timestamp()  # a day of the past is asked for as it ended
    for words, hour in (("yesterday", 24), ("last night", 24), ("today", 36), ("sunday", 0)):
        assert past(words, noon) == pytest.approx(midnight + 3600.0 * hour, abs=0.001)


def test_a_language_limits_how_a_question_is_read(answers: Says) -> None:
    assert "'tasse' means cup" in answers("ask", "wo ist die Tasse?", "--language", "de-AT, en")
    assert "not understood" in answers("ask", "wo ist die Tasse?", "--language", "en")
    assert "not understood" in answers("ask", "where is the cup?", "--language", "de")
    assert "cup 2 was seen" in answers(
        "ask", "where is the cup?", "--language", "fr"
    )  # has no file
    assert "a language is written de" in answers("ask", "where is the cup?", "--language", "a b")


def test_a_note_on_a_place_is_told_with_its_author(says: Says) -> None:
    def told() -> list[bool]:
        asked = ("ask", "what is in the kitchen?"), ("ask", "where is the kitchen?")
        return [
            "ote by ann: wet floor" in says(*asked[0]),
            "; note by ann: wet floor" in says(*asked[1]),
            "Note wet floor, asserted today at" in says("why", "the kitchen"),
        ]

    assert not any(told())
    says("assert", "the kitchen", "note", "wet", "floor", "--by", "ann")
    assert all(told()) and says("check") == ""
    assert "'note' of objects cannot be asserted" in says(
        "assert", "cup 2", "note", "x", "--by", "a"
    )
    says("retract", "kitchen", "note", "--by", "ann")
    assert not any(told())
