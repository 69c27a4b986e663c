"""Real SPARQL servers of other makers, each without any map."""

from collections.abc import Iterator

import pytest

from kg.model import vocabulary as v
from kg.store.sparql_backend import GRAPHS
from kg.store.sparql_client import SparqlClient
from tests.conftest import running_server, running_virtuoso


@pytest.fixture(scope="session")
def oxigraph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_server(tmp_path_factory.mktemp("oxigraph")) as address:
        yield address


@pytest.fixture(scope="session")
def virtuoso(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_virtuoso(tmp_path_factory.mktemp("virtuoso")) as address:
        yield address


@pytest.fixture(params=["oxigraph"])
def url(request: pytest.FixtureRequest) -> str:
    """Address of an empty SPARQL server; a test may name the virtuoso by an indirect parameter."""
    address: str = request.getfixturevalue(request.param)
    endpoint = SparqlClient.at(address)
    for graph in (*GRAPHS, v.PUBLISHED_GRAPH.value):
        endpoint.update(f"DROP SILENT GRAPH <{graph}>")
    endpoint.close()
    return address
