"""A robot that is a point: drives straight, sees what is near and before it. No simulation of ours.

As a program it speaks the line protocol on its stdin and stdout; its one argument is a JSON object
of `PointRobot`'s settings.
"""

import json
import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any


class PointRobot:
    """Answers commands with messages; `settings` says where it is and how it misbehaves."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.settings = settings
        self.x, self.y, self.heading = settings.get("start", [1.0, 1.0, 0.0])
        self.clock, self.looks, self.gotos = 0.0, 0, 0

    def handle(self, command: dict[str, Any]) -> list[dict[str, Any]]:
        kind = command["type"]
        if kind == "hello":
            hello = {"type": "hello", "protocol": self.settings.get("protocol", 1), "name": "point"}
            return [hello | self.settings.get("hello", {}), self.pose()]
        if kind == "goto":
            return self.goto(command)
        return self.look(command) if kind == "look" else []

    def pose(self) -> dict[str, Any]:
        place = {"x": self.x, "y": self.y, "heading": self.heading, "t": self.clock}
        return {"type": "pose", **place}

    def goto(self, command: dict[str, Any]) -> list[dict[str, Any]]:
        self.gotos += 1
        if self.gotos == self.settings.get("abort_at_goto"):
            return [{"type": "abort", "reason": "battery at 9 %"}]
        if self.gotos == self.settings.get("blocked_at_goto"):
            x, y = self.settings["door"]
            said = {"id": command["id"], "x": x, "y": y, "reason": "the door is closed"}
            return [self.pose(), {"type": "blocked", **said}]
        if self.settings.get("goto_fails"):
            return [{"type": "error", "id": command["id"], "reason": "no wheels"}]
        self.clock += math.hypot(command["x"] - self.x, command["y"] - self.y) / 0.5 + 1.0
        passing = self.on_the_way(command) if self.settings.get("on_the_way") else []
        offset = self.settings.get("offset", 0.0)
        self.x, self.y = command["x"] + offset, command["y"]
        self.heading = command["heading"]
        return [*passing, self.pose(), {"type": "arrived", "id": command["id"]}]

    def on_the_way(self, command: dict[str, Any]) -> list[dict[str, Any]]:
        """Pictures of nothing, one in half a metre."""
        dx, dy = command["x"] - self.x, command["y"] - self.y
        count, heading = int(math.hypot(dx, dy) / 0.5), math.atan2(dy, dx)
        parts = [(n + 1) / (count + 1) for n in range(count)]
        poses = [
            {"x": self.x + p * dx, "y": self.y + p * dy, "heading": heading, "t": self.clock}
            for p in parts
        ]
        return [
            {"type": "detections", "objects": [], "pose": {"type": "pose"} | pose} for pose in poses
        ]

    def look(self, command: dict[str, Any]) -> list[dict[str, Any]]:
        self.looks += 1
        self.clock += 1.0 + abs(command["turn"]) / 0.8
        middle = self.heading + command["turn"] / 2
        self.heading += command["turn"]
        things = self.settings.get("objects", [])
        seen = [thing for thing in things if self.sees(thing, middle, command)]
        if self.looks == self.settings.get("phantom_at_look"):
            seen.append(["apple", self.x + 2, self.y, 0.8, 0.4])
        keys = ("label", "x", "y", "z", "score", "frame", "box", "range")
        objects = [dict(zip(keys, thing, strict=False)) for thing in seen]
        return [self.pose(), {"type": "detections", "id": command["id"], "objects": objects}]

    def sees(self, thing: list[Any], middle: float, command: dict[str, Any]) -> bool:
        _, x, y, *_ = thing
        bearing = math.atan2(y - self.y, x - self.x)
        off = abs(math.remainder(bearing - middle, 2 * math.pi))
        return math.hypot(x - self.x, y - self.y) <= 4.6 and off <= command["extent"] / 2 + 1e-6


def main() -> None:
    robot = PointRobot(json.loads(sys.argv[1]))
    settings = robot.settings
    for line in sys.stdin:
        command = json.loads(line)
        if command["type"] == "look" and robot.looks + 1 == settings.get("at_look"):
            misbehave(settings["then"], settings)
        for message in robot.handle(command):
            text = json.dumps(message)
            if settings.get("chatter"):
                sys.stdout.write("INFO starting motors\n\n" + '{"type":"weather","sky":"grey"}\n')
            sys.stdout.write(text[: len(text) // 2])  # half a line first
            sys.stdout.flush()
            sys.stdout.write(text[len(text) // 2 :] + "\n")
            sys.stdout.flush()


def misbehave(how: str, settings: dict[str, Any]) -> None:
    if how == "kill":
        os.kill(os.getppid(), signal.SIGKILL)
        sys.exit(0)
    elif how == "terminate":
        os.kill(os.getppid(), signal.SIGTERM)
    elif how == "end":
        sys.exit(7)
    elif how == "wait":
        while not Path(settings["until"]).exists():
            time.sleep(0.02)
    elif how == "flood":
        while True:
            sys.stdout.write("x" * 100_000 + "\n")


if __name__ == "__main__":
    try:
        main()
    except BrokenPipeError:
        os._exit(0)
