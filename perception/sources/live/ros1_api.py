"""XML-RPC of ROS 1 masters and nodes (wiki.ros.org: Master_API, Slave_API), as a client."""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any, Final
from xml.parsers.expat import ExpatError

from kg.model.errors import RecordingError

CALLER: Final = "/hereabouts"
PATIENCE: Final = 5.0  # [s] for an answer
MAX_ANSWER: Final = 1 << 24  # [bytes] of the master or a node

#: errors of a request to a master, a node, or another program at its address
FAILURES: Final = (
    OSError,
    xmlrpc.client.Error,
    http.client.HTTPException,
    ExpatError,
    RecordingError,
    ValueError,  # among them those of wrong types and encodings
    TypeError,
    LookupError,
    OverflowError,
)


def ask(uri: str, method: str, *arguments: Any, caller: str) -> Any:
    """Answer of a master or a node; raises one of FAILURES."""
    with xmlrpc.client.ServerProxy(uri, transport=_Transport()) as proxy:
        answer = getattr(proxy, method)(caller, *arguments)
    if not (isinstance(answer, list) and len(answer) == 3):
        raise RecordingError(f"{method}: answered by what is no ROS 1 master or node")
    code, said, value = answer
    if code != 1:
        raise RecordingError(f"{method} failed: {said}")
    return value


class _Transport(xmlrpc.client.Transport):
    """HTTP with a time limit, and answers of limited size."""

    accept_gzip_encoding = False

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = http.client.HTTPConnection(str(host), timeout=PATIENCE)
        self._connection = host, connection  # what `close` closes
        return connection

    def parse_response(self, response: Any) -> Any:
        data = response.read(MAX_ANSWER + 1)
        if len(data) > MAX_ANSWER:
            raise RecordingError(f"an answer of more than {MAX_ANSWER} bytes")
        parser, unmarshaller = self.getparser()
        parser.feed(data)
        parser.close()
        return unmarshaller.close()
