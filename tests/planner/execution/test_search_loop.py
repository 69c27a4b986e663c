"""Searches with a robot that is another process: found, given up, surprised, cut short, resumed."""

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError, LayoutError, RobotError, UnknownCategoryError
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from planner.execution.options import Event, SearchOptions
from planner.execution.protocol import Command, Message, RobotPose, encoded, message_of
from planner.execution.robot import MessageQueue
from planner.execution.search_log import SHUT, SearchLog, recent_obstacles
from planner.execution.search_loop import search
from tests.planner.point_robot import PointRobot
from tests.planner.robots import APPLE, FAR_APPLE, START, ring, run


@pytest.fixture
def semantic_map() -> Iterator[SemanticMap]:
    with in_memory_map() as semantic_map:
        ring(semantic_map)
        yield semantic_map


def _well_made(semantic_map: SemanticMap) -> bool:
    return not check_map(semantic_map.store.native)


def test_what_is_found_is_in_the_map_with_every_look_that_led_there(semantic_map):
    before = semantic_map.sequence
    outcome = run(semantic_map, "apple", objects=[APPLE], chatter=True)
    assert outcome.state == "found"
    (record,) = semantic_map.searches.all()
    assert (record.state, record.words, record.left) == ("found", ("apple",), 0.0)
    (apple,) = semantic_map.objects("apple")
    assert record.found == (apple.iri,)
    assert apple.p_map == pytest.approx(APPLE[1:4])
    assert apple.place == semantic_map.place_iri(2)
    looks = semantic_map.searches.looks(record.iri)
    assert [look.number for look in looks] == list(range(1, outcome.looks + 1))
    assert looks[-1].found == (apple.iri,)
    assert not any(look.found for look in looks[:-1])
    assert _well_made(semantic_map)
    causes = [change.cause for change in semantic_map.history.changes(before)]
    assert {(cause.kind, cause.by) for cause in causes} == {("search", "search/1")}
    assert len([c for c in causes if c.note.startswith("look ")]) == outcome.looks
    assert (causes[0].note, causes[-1].note) == ("begun", "found")


def test_giving_up_says_what_is_left_and_what_is_remembered_in_vain_is_doubted() -> None:
    with in_memory_map() as semantic_map:
        ring(semantic_map, apples=1)
        (before,) = semantic_map.objects("apple")
        outcome = run(semantic_map, "apple")
        assert outcome.state == "given up"
        assert 0 < outcome.left < 0.5
        assert semantic_map.searches.all()[0].left == pytest.approx(outcome.left, abs=1e-3)
        after = semantic_map.objects("apple")
        assert not after or after[0].existence < before.existence
        assert _well_made(semantic_map)


def test_pictures_on_the_way_count_and_are_kept(semantic_map: SemanticMap) -> None:
    standing = run(semantic_map, "apple")
    driving = run(semantic_map, "apple", on_the_way=True)
    assert driving.looks < standing.looks
    passed = [
        [look.glimpses for look in semantic_map.searches.looks(record.iri)]
        for record in semantic_map.searches.all()
    ]
    assert sorted(any(glimpses) for glimpses in passed) == [False, True]


def test_a_time_budget_ends_the_search(semantic_map: SemanticMap) -> None:
    outcome = run(semantic_map, "apple", budget=10.0)
    assert outcome.state == "given up"
    assert outcome.reason == "the time budget is used up"
    assert outcome.left > 0
    again = run(semantic_map, "apple", resume=True, objects=[FAR_APPLE])
    assert again.state == "found"
    assert again.search == outcome.search
    assert again.seconds > outcome.seconds


def test_all_that_is_wanted_is_searched_for(semantic_map: SemanticMap) -> None:
    things = [["cup", 6.0, 2.0, 0.8, 0.9], ["bed", 6.0, 6.5, 0.4, 0.8]]
    outcome = run(semantic_map, "something to drink from", "bed", objects=things)
    assert outcome.state == "found"
    cup, bed = semantic_map.objects("cup")[0].iri, semantic_map.objects("bed")[0].iri
    assert {cup, bed} == set(outcome.found)
    looks = semantic_map.searches.looks(outcome.search)
    assert len(looks[-1].categories) < len(looks[0].categories)  # one was found before


def test_a_doubtful_detection_is_looked_at_again_and_let_go(semantic_map: SemanticMap) -> None:
    events: list[Event] = []
    outcome = run(semantic_map, "apple", phantom_at_look=1, on_event=events.append)
    assert outcome.state == "given up"
    assert any(e.kind == "surprise" and "perhaps apple" in e.text for e in events)
    assert all(record.existence < 0.5 for record in semantic_map.objects("apple"))


def test_what_is_found_exists_rather_than_not(semantic_map: SemanticMap) -> None:
    weak = ["apple", 6.0, 2.0, 0.8, 0.3]  # two such detections do not make it likely
    outcome = run(semantic_map, "apple", objects=[weak])
    assert outcome.state == "found"
    (apple,) = semantic_map.objects("apple")
    assert outcome.found == (apple.iri,)
    assert apple.existence >= 0.5
    assert apple.observations >= 3


def test_what_stays_unlikely_is_looked_at_straight_three_times_and_not_found(semantic_map):
    events: list[Event] = []
    unlikely = ["apple", 6.0, 2.0, 0.8, 0.12]
    outcome = run(semantic_map, "apple", objects=[unlikely], on_event=events.append)
    assert outcome.state == "given up"
    straight = [e for e in events if e.kind == "surprise" and "perhaps apple" in e.text]
    assert 1 <= len(straight) <= 3


def test_a_closed_door_leads_to_another_plan(semantic_map: SemanticMap) -> None:
    events: list[Event] = []
    outcome = run(
        semantic_map,
        "apple",
        objects=[APPLE],
        blocked_at_goto=1,
        door=[4.0, 2.1],
        on_event=events.append,
    )
    assert outcome.state == "found"
    (obstacle,) = semantic_map.searches.obstacles(outcome.search)
    assert (obstacle.position, obstacle.reason) == ((4.0, 2.1), "the door is closed")
    first, second, *_ = [e.data for e in events if e.kind == "plan"]
    into_kitchen = first["place"] == second["place"] == "place 2"
    assert not into_kitchen or second["expected_seconds"] > first["expected_seconds"] + 5
    assert _well_made(semantic_map)


def test_what_was_in_the_way_counts_in_the_next_search_and_is_forgotten_in_time(semantic_map):
    door, first = [4.0, 2.1], {}
    for when, later, shut in (("before", 0.0, 1), ("soon", 60.0, 0), ("later", 7200.0, 0)):
        events: list[Event] = []
        run(
            semantic_map,
            "apple",
            later=later,
            objects=[APPLE],
            blocked_at_goto=shut,
            door=door,
            on_event=events.append,
        )
        semantic_map.apply(MapUpdate(removed=tuple(o.iri for o in semantic_map.objects("apple"))))
        first[when] = next(e.data for e in events if e.kind == "plan")
    assert first["soon"]["expected_seconds"] > first["before"]["expected_seconds"] + 5
    assert first["later"]["expected_seconds"] == first["before"]["expected_seconds"]


@pytest.mark.parametrize(
    ("seconds", "state", "counts"),
    [
        (0.4, "given up", True),  # stamps are whole seconds, this one lies ahead
        (-5.0, "given up", True),  # by the slower clock of another robot
        (SHUT - 1, "running", True),  # it was killed
        (SHUT + 1, "running", False),
        (SHUT + 1, "given up", False),
        (-SHUT - 1, "given up", False),
    ],
)
def test_what_lately_was_in_the_way_of_another_search_counts(seconds, state, counts):
    at = 1_000_000.6
    with in_memory_map() as semantic_map:
        apple = semantic_map.catalogue.find("apple").iri
        diary = SearchLog.begin(semantic_map, ["apple"], [apple], lambda: at)
        diary.obstacle(RobotPose(1.0, 1.0, 0.0), 4.0, 2.0, "the door is closed")
        if state != "running":
            diary.end(state, None)
        found = recent_obstacles(semantic_map, f"{semantic_map.base}search/2", at + seconds)
        assert [o.reason for o in found] == ["the door is closed"] * counts
        assert recent_obstacles(semantic_map, diary.record.iri, at) == ()


def test_ways_that_were_shut_to_others_are_tried_before_giving_up() -> None:
    with in_memory_map() as semantic_map:
        ring(semantic_map, rooms=2)
        far = ["apple", 7.95, 2.0, 0.8, 0.9]  # out of range of the corridor
        shut = run(semantic_map, "apple", blocked_at_goto=1, door=[4.0, 2.0], objects=[far])
        assert shut.state == "given up"
        assert shut.looks < 100  # what is behind the door keeps nobody looking at the corridor
        events: list[Event] = []
        assert run(semantic_map, "apple", objects=[far], on_event=events.append).state == "found"
        assert sum("may be gone by now" in e.text for e in events) == 1


def test_a_robot_that_cannot_stand_there_is_not_sent_there_for_ever(semantic_map):
    events: list[Event] = []
    outcome = run(semantic_map, "apple", offset=0.8, on_event=events.append)
    assert outcome.state == "given up"
    goals = [(e.data["x"], e.data["y"]) for e in events if e.kind == "plan"]
    assert len(goals) == len(set(goals))


def test_a_robot_all_of_whose_commands_fail_is_no_robot(semantic_map: SemanticMap) -> None:
    try:
        outcome = run(semantic_map, "apple", goto_fails=True)
    except RobotError as error:
        assert "commands in a row failed" in str(error)
        assert semantic_map.searches.all()[0].state == "stopped"
    else:
        assert outcome.state == "given up"
        assert outcome.looks == 0


def test_a_robot_that_ends_the_search_can_take_it_up_again(semantic_map: SemanticMap) -> None:
    stopped = run(semantic_map, "apple", objects=[FAR_APPLE], abort_at_goto=2)
    assert stopped.state == "stopped"
    assert "battery at 9 %" in stopped.reason
    events: list[Event] = []
    again = run(semantic_map, resume=True, objects=[FAR_APPLE], on_event=events.append)
    assert (again.state, again.search) == ("found", stopped.search)
    assert events[0].data["looks"] == stopped.looks
    assert events[0].data["left"] == pytest.approx(stopped.left, abs=1e-3)


@pytest.mark.parametrize(
    ("how", "said"), [("end", "has ended with exit code 7"), ("flood", "messages in a row")]
)
def test_a_robot_that_fails_leaves_a_search_that_can_go_on(semantic_map, how, said):
    with pytest.raises(RobotError, match=said):
        run(semantic_map, "apple", at_look=2, then=how)
    (record,) = semantic_map.searches.all()
    assert record.state == "stopped"
    assert len(semantic_map.searches.looks(record.iri)) == 1
    assert run(semantic_map, "apple", resume=True, objects=[FAR_APPLE]).state == "found"


class _FallsSilent:
    """A robot that answers the first commands and then nothing; time passes as it is waited for."""

    name = "the quiet robot"

    def __init__(self, answers: int) -> None:
        self.now = 0.0
        self.sent: list[str] = []
        self._left, self._point = answers, PointRobot({})
        self._said: list[Message] = []

    def send(self, command: Command) -> None:
        said = encoded(command)
        self.sent.append(said["type"])
        self._left -= 1
        if self._left >= 0:
            self._said += [m for m in map(message_of, self._point.handle(said)) if m is not None]

    def receive(self, seconds: float) -> Message | None:
        self.now += seconds
        return self._said.pop(0) if self._said else None

    def close(self) -> None:
        self.sent.append("closed")


def test_a_robot_that_falls_silent_is_not_waited_for_for_ever(semantic_map, monkeypatch):
    robot = _FallsSilent(answers=4)  # hello, goto, look, goto
    clock = SimpleNamespace(monotonic=lambda: robot.now)
    monkeypatch.setattr("planner.execution.robot_session.time", clock)
    with pytest.raises(RobotError, match="has been silent for 30 s"):
        search(
            semantic_map, ["apple"], robot, SearchOptions(timeout=30.0, clock=lambda: START + 60)
        )
    assert robot.sent[-1] == "closed"
    (record,) = semantic_map.searches.all()
    assert (record.state, len(semantic_map.searches.looks(record.iri))) == ("stopped", 1)


class _SaysWrongly(_FallsSilent):
    """Says hello with a speed that is none, and nothing else."""

    name = "the robot"

    def __init__(self) -> None:
        super().__init__(answers=0)
        self._inbox = MessageQueue(self.name)

    def receive(self, seconds: float) -> Message | None:
        self.now += 1.0
        if self.now > 5:
            return None
        return self._inbox.read(b'{"type":"hello","protocol":1,"speed":-1}')


def test_a_robot_that_says_nothing_of_the_protocol_is_told_what_was_wrong(
    semantic_map: SemanticMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = _SaysWrongly()
    clock = SimpleNamespace(monotonic=lambda: robot.now)
    monkeypatch.setattr("planner.execution.robot_session.time", clock)
    with pytest.raises(RobotError, match=r"of the protocol, the last: speed must lie in 0\.001"):
        search(
            semantic_map, ["apple"], robot, SearchOptions(timeout=30.0, clock=lambda: START + 60)
        )
    assert semantic_map.searches.all() == ()


def test_another_version_of_the_protocol_is_refused_and_nothing_is_begun(semantic_map):
    with pytest.raises(RobotError, match="speaks version 2"):
        run(semantic_map, "apple", protocol=2)
    assert semantic_map.searches.all() == ()


def test_errors_say_what_would_have_worked(semantic_map: SemanticMap) -> None:
    with pytest.raises(GraphError, match="no unfinished search for apple"):
        run(semantic_map, "apple", resume=True)
    with pytest.raises(UnknownCategoryError, match="did you mean apple"):
        run(semantic_map, "aple")
    with in_memory_map() as empty, pytest.raises(LayoutError, match="nowhere to"):
        run(empty, "apple")


def test_what_the_robot_saw_by_the_way_is_in_the_map_too(semantic_map: SemanticMap) -> None:
    things = [APPLE, ["oven", 6.0, 2.2, 0.5, 0.8], ["flux capacitor", 6.1, 2.0, 0.5, 0.9]]
    events: list[Event] = []
    run(semantic_map, "apple", objects=things, on_event=events.append)
    assert len(semantic_map.objects("oven")) == 1
    assert any("flux capacitor" in e.text for e in events if e.kind == "note")


def test_an_object_that_another_absorbs_leaves_the_map(semantic_map: SemanticMap) -> None:
    table = semantic_map.catalogue.find("dining table").iri
    x, y = APPLE[1:3]
    halves = [
        ObjectRecord(
            iri=f"{semantic_map.base}object/{number}",
            category=table,
            p_map=np.array([x + shift, y, 0.7]),
            confidence=2.7,
            existence=0.9,
            observations=9,
            first_seen=0.0,
            last_seen=0.0,
        )
        for number, shift in ((1, -0.1), (2, 0.25))
    ]
    semantic_map.apply(MapUpdate(objects=tuple(halves)))
    run(semantic_map, "apple", objects=[APPLE, ["dining table", x, y, 0.7, 0.9]])
    assert len(semantic_map.objects("dining table")) == 1
    assert _well_made(semantic_map)
