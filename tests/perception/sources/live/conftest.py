"""A room as messages."""

from collections.abc import Callable
from pathlib import Path

import pytest

from perception.sources.bag_writer import write_bag
from perception.sources.bags.bag_file import BagFile, RawMessage
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions

BEGIN = 1_700_000_000  # [s]


@pytest.fixture
def room(hololens: Callable[..., Path]) -> FolderRecording:
    """Six views of a room."""
    return open_recording(hololens(), RecordingOptions(check=False, start_time=float(BEGIN)))


@pytest.fixture
def messages(room: FolderRecording, tmp_path: Path) -> Callable[[str], list[RawMessage]]:
    """Callable: ".bag" (ROS 1) or ".mcap" (ROS 2) -> the room's messages in their order."""

    def read(suffix: str) -> list[RawMessage]:
        path = tmp_path / f"room{suffix}"
        if not path.exists():
            for _ in write_bag(room, path):
                pass
        with BagFile(path) as bag:
            return list(bag.messages([topic.name for topic in bag.topics]))

    return read
