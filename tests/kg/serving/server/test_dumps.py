"""Dumps: whole, of one state, streamed by a process of their own, few at once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Served


@pytest.mark.parametrize("path", ["dump.foo", "dump.ttl", "dump.trig.gz"])
def test_a_dump_in_another_format_is_not_there(served: Served, path: str) -> None:
    answer = served.get(path)
    assert answer.status_code == 404
    assert "/dump.trig" in answer.text


def test_many_dumps_at_once_are_all_whole(served: Served) -> None:
    whole = served.get("dump.nq").content
    with ThreadPoolExecutor(8) as threads:
        dumps = list(threads.map(lambda _: served.get("dump.nq"), range(8)))
    assert {answer.status_code for answer in dumps} == {200}
    assert {answer.content for answer in dumps} == {whole}
    assert whole.count(b"\n") == len(served.map.engine)
