"""A live map is not interrupted by collections of what stays anyway."""

from __future__ import annotations

import gc

import pytest

from kg.pauses import settled


def test_what_is_loaded_is_spared_for_the_length_of_the_block() -> None:
    before = gc.get_freeze_count()
    mine = [[]]
    with pytest.raises(KeyError), settled():
        assert gc.get_freeze_count() > before
        assert all(found is not mine for found in gc.get_objects())
        raise KeyError
    assert any(found is mine for found in gc.get_objects())
