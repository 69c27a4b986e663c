"""Problem documents of errors: status, and when to try again."""

from pathlib import Path

import pytest

from kg.model import errors
from kg.serving.server.http.problems import problem_of, without_paths

KINDS = [
    kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, errors.HereaboutsError)
]


@pytest.mark.parametrize("kind", KINDS)
def test_only_what_passes_is_to_be_tried_again_and_a_busy_server_later(kind) -> None:
    problem = problem_of(kind("no luck"))
    passing = problem.status == 503 and not issubclass(kind, errors.QueryTooLargeError)
    assert ("Retry-After" in problem.headers) == passing
    if passing:
        busy = issubclass(kind, errors.PoolBusyError)
        assert int(problem.headers["Retry-After"]) == (5 if busy else 1)
    assert (problem.kind, str(problem)) == (kind.__name__, "no luck")
    assert 400 <= problem.status < 600


def test_folders_of_the_server_are_not_told() -> None:
    error = errors.GraphError("cannot read /srv/maps/flat.map/store: no such file in /srv/maps")
    told = str(without_paths(problem_of(error), [Path("/srv/maps"), Path("/srv/maps/flat.map")]))
    assert "/srv" not in told and "store" in told
