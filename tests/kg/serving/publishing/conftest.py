"""A real SPARQL server of another maker, without any map."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from kg.model import vocabulary as v
from kg.store.sparql_backend import GRAPHS
from kg.store.sparql_client import SparqlClient
from tests.conftest import running_server


@pytest.fixture(scope="session")
def oxigraph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_server(tmp_path_factory.mktemp("oxigraph")) as address:
        yield address


@pytest.fixture
def url(oxigraph: str) -> str:
    """Address of an empty SPARQL server."""
    endpoint = SparqlClient.at(oxigraph)
    for graph in (*GRAPHS, v.PUBLISHED_GRAPH.value):
        endpoint.update(f"DROP SILENT GRAPH <{graph}>")
    endpoint.close()
    return oxigraph
