"""One furnished map at all its doors."""

from collections.abc import Iterator

import pytest

from tests.doors.doors import House, open_house
from tests.planner.flat import fill


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """A kitchen with a banana and a cup, a bedroom with a bed, a third room; shared by a module."""
    with open_house(tmp_path_factory.mktemp("house"), fill) as opened:
        yield opened
