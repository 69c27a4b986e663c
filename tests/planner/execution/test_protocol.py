"""What a robot may say, what it may not, and how patient we are."""

import json
import math
import os
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.model.errors import RobotError
from planner.execution.protocol import (
    MAX_LINE,
    Arrived,
    Blocked,
    Detected,
    DetectionsMessage,
    GoTo,
    Hello,
    LookAround,
    MalformedMessage,
    MalformedValueError,
    RobotPose,
    StopCommand,
    cleaned,
    decoded,
    line_of,
)
from planner.execution.robot import MAX_MALFORMED, MessageQueue
from planner.execution.transports.line_transport import Lines


def test_commands_are_lines_of_json() -> None:
    assert line_of(GoTo(3, 1.5, -2.0, 0.25)) == (
        b'{"type":"goto","id":3,"x":1.5,"y":-2.0,"heading":0.25}\n'
    )
    assert line_of(LookAround(4, 2.0, 3.0)) == b'{"type":"look","id":4,"turn":2.0,"extent":3.0}\n'
    assert line_of(StopCommand()) == b'{"type":"stop"}\n'
    assert line_of(Hello()) == b'{"type":"hello","protocol":1,"name":"hereabouts"}\n'


def test_messages_are_read_with_what_may_be_left_out() -> None:
    assert decoded('{"type":"hello","protocol":1,"speed":0.5}') == Hello(1, "robot", 0.5)
    assert decoded('{"type":"pose","x":1,"y":2,"heading":7}') == RobotPose(
        1, 2, pytest.approx(7 - 2 * math.pi)
    )
    assert decoded('{"type":"arrived","id":3}') == Arrived(3)
    assert decoded('{"type":"blocked","x":1,"y":2}') == Blocked(None, 1, 2, "blocked")
    assert decoded('{"type":"detections","id":4,"objects":[]}') == DetectionsMessage(4, ())
    cup = '{"label":"cup","score":0.5,"x":1,"y":2,"frame":"7","box":[1,2,30,40],"range":1.5}'
    assert decoded('{"type":"detections","objects":[' + cup + "]}") == DetectionsMessage(
        None, (Detected("cup", 0.5, 1.0, 2.0, 0.0, "7", (1.0, 2.0, 30.0, 40.0), 1.5),)
    )
    assert decoded('{"type":"made up later"}') is None


@pytest.mark.parametrize(
    "line",
    [
        "",
        "INFO: motors on",
        "[]",
        "{}",
        '{"type":7}',
        '{"type":"arrived"}',
        '{"type":"arrived","id":true}',
        '{"type":"arrived","id":1.5}',
        '{"type":"pose","x":NaN,"y":0,"heading":0}',
        '{"type":"pose","x":Infinity,"y":0,"heading":0}',
        '{"type":"pose","x":"1","y":0,"heading":0}',
        '{"type":"pose","x":1e9,"y":0,"heading":0}',
        '{"type":"pose","x":1' + 400 * "0" + ',"y":0,"heading":0}',
        '{"type":"detections","objects":{}}',
        '{"type":"detections","objects":[{"label":"cup","score":1.5,"x":0,"y":0}]}',
        '{"type":"detections","objects":[{"score":0.5,"x":0,"y":0}]}',
        '{"type":"detections","pose":[1,2,3]}',
        '{"type":"detections","objects":[{"label":"a","score":1,"x":0,"y":0,"box":[1,2,3,4]}]}',
        '{"type":"detections","objects":[{"label":"a","score":1,"x":0,"y":0,"range":-1}]}',
        *(
            '{"type":"detections","objects":[{"label":"a","score":1,"x":0,"y":0,"frame":"1","box":'
            + box
            + "}]}"
            for box in ("7", "[1,2,3]", "[1,2,3,NaN]", '[1,2,3,"4"]', "[3,2,1,4]", "[1,2,3,1e9]")
        ),
        '{"type":"detections","objects":' + json.dumps([{}] * 1001) + "}",
        '{"type":"hello","protocol":"1"}',
        '{"type":"hello","protocol":1,"speed":0}',
        "[" * 100_000,
    ],
)
def test_what_is_no_message_is_refused(line: str) -> None:
    with pytest.raises(MalformedValueError):
        decoded(line)


_KINDS = ("hello", "pose", "arrived", "blocked", "detections", "error", "abort", "other")
_ODD = [None, True, 0, -1, 1.5, 1e300, math.nan, math.inf, 10**400, "", "\x00", [], {}]
_SEEN = [None, {}, {"label": "cup", "score": 0.5, "x": 1, "y": 2}]
_SEEN += [{"label": "cup", "score": 0, "x": 1, "y": 2, "frame": 7, "box": [0, 0, 10**400, 1]}]
_JSON = st.one_of(
    st.sampled_from(_ODD),
    st.floats(),
    st.lists(st.sampled_from(_SEEN), max_size=3),
    st.just({"x": 1, "y": 2, "heading": 1e9}),
)
_KEYS = st.sampled_from(("id", "x", "y", "heading", "t", "reason", "objects", "pose", "protocol"))


@given(st.sampled_from(_KINDS), st.dictionaries(_KEYS, _JSON), st.binary(max_size=200))
def test_nothing_a_robot_says_is_a_bug_of_ours(kind, said, noise):
    with suppress(MalformedValueError):
        decoded(noise)
    try:
        message = decoded(json.dumps({**said, "type": kind}))
    except MalformedValueError:
        return
    if isinstance(message, RobotPose):
        assert math.isfinite(message.x + message.y)
        assert -math.pi <= message.heading <= math.pi


def test_reasons_cannot_write_to_the_terminal() -> None:
    assert cleaned("no\x1b[2J way\r\n here") == "no [2J way here"
    assert len(cleaned("x" * 10_000)) == 300


def test_a_robot_may_talk_nonsense_now_and_then_but_not_only() -> None:
    inbox = MessageQueue("the robot")
    for _ in range(3):
        for _ in range(MAX_MALFORMED - 1):
            assert isinstance(inbox.read(b"garbage"), MalformedMessage)
        assert inbox.read(b'{"type":"arrived","id":1}') == Arrived(1)
    for _ in range(MAX_MALFORMED - 1):
        inbox.read(b"garbage")
    with pytest.raises(RobotError, match="20 messages in a row"):
        inbox.read(b"garbage")


def test_lines_come_whole_however_they_are_cut() -> None:
    reads, writes = os.pipe()
    lines = Lines(reads)
    os.write(writes, b"first\nsec")
    assert lines.next(1.0) == b"first"
    with pytest.raises(TimeoutError):
        lines.next(0.0)
    os.write(writes, b"ond\nhalf")
    os.close(writes)
    assert lines.next(1.0) == b"second"
    assert isinstance(lines.next(1.0), EOFError)  # half a line is none
    os.close(reads)


def test_a_line_that_is_too_long_is_dropped_and_the_next_one_is_read() -> None:
    reads, writes = os.pipe()
    lines = Lines(reads)
    sent = 0
    while sent <= MAX_LINE + 1:
        sent += os.write(writes, b"x" * 60_000)
        with pytest.raises(TimeoutError):
            lines.next(0.0)
    os.write(writes, b"\nok\n")
    assert lines.next(1.0) is None
    assert lines.next(1.0) == b"ok"
    os.close(writes)
    os.close(reads)
