"""Headers of ROS messages: stamps and frame names."""

from __future__ import annotations

from typing import Any

NANOSECONDS = 1_000_000_000


def nanoseconds(header: Any) -> int:
    """Stamp of a std_msgs/Header [ns]; 0 where it was not set."""
    stamp = header.stamp
    if hasattr(stamp, "nanosec"):
        return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
    return int(stamp.secs) * NANOSECONDS + int(stamp.nsecs)


def frame_name(name: str) -> str:
    """Name of a frame without the leading slash that ROS 1 sometimes has."""
    return name.lstrip("/")
