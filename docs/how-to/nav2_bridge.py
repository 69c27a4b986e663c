"""A bridge from `hereabouts search` to Nav2: the robot protocol on one side, Nav2 on the other.

A sketch by the documented interfaces, not run on a robot. Start it by
`hereabouts search MAP cup --robot 'stdio:python3 nav2_bridge.py'`; docs/how-to/ros.md explains it.
"""

import contextlib
import json
import math
import sys
import threading

import rclpy
from geometry_msgs.msg import PoseStamped
from nav2_simple_commander.robot_navigator import BasicNavigator, TaskResult
from rclpy.time import Time
from tf2_ros import Buffer, TransformException, TransformListener
from vision_msgs.msg import Detection3DArray

STOP = threading.Event()
OUT = threading.Lock()


def send(kind, **data):
    """Send one message to the search."""
    with OUT:
        sys.stdout.write(json.dumps({"type": kind, **data}) + "\n")
        sys.stdout.flush()


class Bridge:
    """One robot: its goals, its pose and its detections."""

    def __init__(self):
        self.nav = BasicNavigator()
        self.buffer = Buffer()
        self.tf = TransformListener(self.buffer, self.nav)
        self.latest, self.detected, self.looking = [], [], False
        self.nav.create_subscription(Detection3DArray, "detections", self.on_detections, 5)
        self.nav.waitUntilNav2Active()

    def on_detections(self, message):
        """Keep the detections of a look; report those on the way at once."""
        self.latest = [self.detection(d) for d in message.detections if d.results]
        if self.looking:
            self.detected += self.latest
        elif self.latest:
            send("detections", objects=self.latest, pose=self.pose())

    def detection(self, message):
        """Return the best hypothesis of a detection, at the centre of its box."""
        best = max(message.results, key=lambda r: r.hypothesis.score)
        at = message.bbox.center.position
        score = min(max(best.hypothesis.score, 0.0), 1.0)
        return {"label": best.hypothesis.class_id, "score": score, "x": at.x, "y": at.y, "z": at.z}

    def pose(self):
        """Return the pose of the robot in the map frame [m, rad, s]."""
        tf = self.buffer.lookup_transform("map", "base_link", Time()).transform
        q, p = tf.rotation, tf.translation
        heading = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
        seconds = self.nav.get_clock().now().nanoseconds / 1e9
        return {"x": p.x, "y": p.y, "heading": heading, "t": seconds}

    def wait(self):
        """Wait until the task is done or stopped, and send the pose every 0.1 s."""
        while not self.nav.isTaskComplete():  # spins the node, for 0.1 s at most
            if STOP.is_set():
                self.nav.cancelTask()
            with contextlib.suppress(TransformException):  # not localised yet: --patience covers it
                send("pose", **self.pose())
        send("pose", **self.pose())
        return self.nav.getResult()

    def goto(self, id, x, y, heading):
        """Drive to a viewpoint."""
        goal = PoseStamped()
        goal.header.frame_id = "map"
        goal.header.stamp = self.nav.get_clock().now().to_msg()
        goal.pose.position.x, goal.pose.position.y = float(x), float(y)
        goal.pose.orientation.z = math.sin(heading / 2)
        goal.pose.orientation.w = math.cos(heading / 2)
        self.nav.goToPose(goal)
        if self.wait() == TaskResult.SUCCEEDED:
            send("arrived", id=id)
        elif not STOP.is_set():
            send("error", id=id, reason="Nav2 found no way")

    def look(self, id, turn, extent):
        """Turn by `turn` [rad] and collect the detections of all images on the way."""
        self.looking, self.detected = True, []
        for _ in range(10):  # an image before the turn
            rclpy.spin_once(self.nav, timeout_sec=0.1)
        if abs(turn) > 0.05:
            self.nav.spin(spin_dist=turn, time_allowance=60)
            self.wait()
        self.looking = False
        send("detections", id=id, objects=self.detected[:1000])


def commands(queue, arrived):
    """Read the commands of the search from stdin until it ends."""
    for line in sys.stdin:
        command = json.loads(line)
        if command["type"] == "stop":
            STOP.set()  # also while a command is under way
        else:
            queue.append(command)
            arrived.set()
    STOP.set()
    queue.append(None)  # the search is over
    arrived.set()


def main():
    """Answer one command after the other."""
    rclpy.init()
    bridge, queue, arrived = Bridge(), [], threading.Event()
    threading.Thread(target=commands, args=(queue, arrived), daemon=True).start()
    while True:
        rclpy.spin_once(bridge.nav, timeout_sec=0.05)
        if not queue:
            arrived.clear()
            continue
        command = queue.pop(0)
        if command is None:
            break
        STOP.clear()
        kind = command.pop("type")
        if kind == "hello":
            send("hello", protocol=1, name="nav2", speed=0.3, turn_rate=1.0)
            send("pose", **bridge.pose())
        elif kind == "goto":
            bridge.goto(**command)
        elif kind == "look":
            bridge.look(**command)
    bridge.nav.cancelTask()


main()
