"""`python -m lab.questions make | ask | answer | score`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from kg.model.errors import GraphError
from kg.serving.opening import in_memory_map
from lab.command_line import parser_of, run
from lab.questions import __doc__ as about
from lab.questions.asking import INTERFACES, Answered, answered_by, ask, differing, table
from lab.questions.blind import BlindAnswers
from lab.questions.generator import questions_of
from lab.questions.graph_maps import mapped, true, truths
from lab.questions.house_drives import SESSIONS, HouseFacts, drive
from lab.questions.plain_map import PlainMap
from lab.questions.question_file import HouseQuestion, load_questions, read_json, save_questions
from perception.sources.recording_writer import write_text


def main(argv: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = parser_of("lab.questions", about)
    commands = parser.add_subparsers(required=True)
    make = commands.add_parser("make", help="write questions, recordings and truth")
    make.add_argument("--houses", type=_seeds, default="601-606", metavar="N-M", help="seeds")
    make.add_argument("--each", type=int, default=6, help="questions of a family in each house")
    make.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="new folder")
    make.add_argument(
        "--no-recordings", action="store_true", help="write only the questions and the true maps"
    )
    make.set_defaults(run=_make)
    asking = commands.add_parser("ask", help="ask maps of hereabouts through all interfaces")
    asking.add_argument("folder", type=Path)
    asking.add_argument("--houses", type=_seeds, metavar="N-M", help="only these")
    asking.add_argument("--wrong", action="store_true", help="also list what is not right")
    asking.set_defaults(run=_ask)
    answer = commands.add_parser("answer", help="answer from plain maps, HOUSE.json in a folder")
    answer.add_argument("folder", type=Path)
    answer.add_argument("maps", type=Path, help="folder with HOUSE.json, HOUSE-before.json")
    answer.set_defaults(run=_answer)
    scoring = commands.add_parser("score", help="score a JSON of {question's id: answer}")
    scoring.add_argument("folder", type=Path)
    scoring.add_argument("answers", type=Path)
    scoring.set_defaults(run=_score)
    return run(parser, lambda arguments: int(arguments.run(arguments)), argv)


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def _make(arguments: argparse.Namespace) -> int:
    questions, houses = list[HouseQuestion](), dict[str, dict[str, object]]()
    for seed in arguments.houses:
        folder = None if arguments.no_recordings else arguments.output / f"house-{seed}"
        facts = drive(seed, folder)
        write_truth(facts, arguments.output, folder)
        questions += questions_of(facts, arguments.each)
        rooms = [room["label"] for room in facts.now["rooms"]]
        houses[str(seed)] = {"rooms": rooms}
        if folder is not None:
            houses[str(seed)] |= {"folder": folder.name, "recordings": SESSIONS}
        _say(f"house {seed}: {sum(one.house == str(seed) for one in questions)} questions")
    save_questions(arguments.output, questions, houses)
    return 0


def write_truth(facts: HouseFacts, output: Path, folder: Path | None) -> None:
    """Write the true maps of both moments: beside the recordings, or as HOUSE.json in maps/."""
    names = ("truth-before", "truth") if folder else (f"{facts.number}-before", facts.number)
    place = folder or output / "maps"
    place.mkdir(parents=True, exist_ok=True)
    for name, document in zip(names, (facts.before, facts.now), strict=True):
        text = json.dumps(document, separators=(",", ":"))
        write_text(place / f"{name}.json", text + "\n")


def _ask(arguments: argparse.Namespace) -> int:
    questions = load_questions(arguments.folder)
    with in_memory_map() as nothing:
        blind = BlindAnswers(questions, nothing)
        found = [Answered("blind", "none", one, blind.answer(one)) for one in questions]
    for number in dict.fromkeys(one.house for one in questions):
        if arguments.houses and int(number) not in arguments.houses:
            continue
        house = arguments.folder / f"house-{number}"
        put = [one for one in questions if one.house == number]
        demo, hard = mapped(house, "demo"), mapped(house, "hard")
        asked = {
            "true map": true(*truths(house), demo.semantic_map),
            "demo senses": demo,
            "hard senses": hard,
        }
        for name, each in asked.items():
            found += ask(name, each, put)
            each.semantic_map.close()
        _say(f"house {number}: asked")
    _report(found, wrong=arguments.wrong)
    return 0


def _report(found: Sequence[Answered], *, wrong: bool) -> None:
    for name in dict.fromkeys(one.map for one in found if one.map != "blind"):
        of_map = [one for one in found if one.map == name]
        apart = differing(of_map)
        count = len({one.question.id for one in of_map})
        _say(f"\n{name}, by interface; they differ on {len(apart)} of {count} questions\n")
        _say(table(of_map, "interface"))
        for group in apart:
            answers = {one.interface: one.given for one in group}
            _say(f"differ: {group[0].question.id} {answers}")
    _say("\nmean of the interfaces, and without a map\n")
    _say(table([one for one in found if one.interface in (*INTERFACES, "none")], "map"))
    for one in found if wrong else ():
        if one.score < 1.0 and one.map != "blind":
            question = one.question
            _say(f"{one.map}, {one.interface}: {question.id} {question.text} {one.given}, "
                 f"truly {question.answer}")  # fmt: skip


def _answer(arguments: argparse.Namespace) -> int:
    answers = dict[str, Any]()
    for number, questions in _by_house(load_questions(arguments.folder)):
        before = arguments.maps / f"{number}-before.json"
        then = read_json(before) if before.exists() else None
        adapter = PlainMap(read_json(arguments.maps / f"{number}.json"), then)
        answers |= {one.id: answered_by(adapter, one) for one in questions}
    _say(json.dumps(answers, indent=1))
    return 0


def _by_house(questions: Iterable[HouseQuestion]) -> Iterable[tuple[str, list[HouseQuestion]]]:
    houses: dict[str, list[HouseQuestion]] = {}
    for one in questions:
        houses.setdefault(one.house, []).append(one)
    return houses.items()


def _score(arguments: argparse.Namespace) -> int:
    answers = read_json(arguments.answers)
    if not isinstance(answers, dict):
        raise GraphError(f"{arguments.answers} is no object; {{QUESTION'S ID: ANSWER}} would work")
    questions = load_questions(arguments.folder)
    _say(table([Answered("score", "", one, answers.get(one.id)) for one in questions], "map"))
    return 0


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
