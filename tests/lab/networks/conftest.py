"""Fixtures of the tests of networks that these tests share."""

from tests.perception.conftest import write_network

__all__ = ["write_network"]
