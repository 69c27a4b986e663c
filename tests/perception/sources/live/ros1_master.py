"""A ROS 1 master, as far as publishers and those that ask it for topics need one."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

from perception.sources.live.ros1 import Ros1Master


class FakeMaster:
    """Keeps who publishes what; `forget` is what a restart does."""

    def __init__(self) -> None:
        self.types: dict[str, str] = {}
        self.publishers: dict[str, dict[str, str]] = {}  # topic -> node -> its API
        self.parameters: dict[str, Any] = {}
        self.server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        for name in ("getTopicTypes", "getSystemState", "lookupNode"):
            self.server.register_function(getattr(self, name), name)
        for name in ("registerPublisher", "unregisterPublisher", "setParam"):
            self.server.register_function(getattr(self, name), name)
        self._thread = threading.Thread(target=self.server.serve_forever, args=(0.02,))
        self._thread.start()

    @property
    def address(self) -> Ros1Master:
        return Ros1Master("127.0.0.1", self.server.server_address[1])

    def forget(self) -> None:
        self.publishers = {}

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()
        self._thread.join()

    def getTopicTypes(self, caller: str) -> list[Any]:  # noqa: N802 - the protocol's names
        return [1, "", [[topic, type_] for topic, type_ in self.types.items()]]

    def getSystemState(self, caller: str) -> list[Any]:  # noqa: N802
        listed = [[topic, list(nodes)] for topic, nodes in self.publishers.items()]
        return [1, "", [listed, [], []]]

    def lookupNode(self, caller: str, node: str) -> list[Any]:  # noqa: N802
        apis = [nodes[node] for nodes in self.publishers.values() if node in nodes]
        return [1, "", apis[0]] if apis else [-1, "unknown node", ""]

    def registerPublisher(self, caller: str, topic: str, type_: str, api: str) -> list[Any]:  # noqa: N802
        self.types[topic] = type_
        self.publishers.setdefault(topic, {})[caller] = api
        return [1, "", []]

    def unregisterPublisher(self, caller: str, topic: str, api: str) -> list[Any]:  # noqa: N802
        return [1, "", int(self.publishers.get(topic, {}).pop(caller, None) is not None)]

    def setParam(self, caller: str, name: str, value: Any) -> list[Any]:  # noqa: N802
        self.parameters[name] = value
        return [1, "", 0]


@contextmanager
def fake_master() -> Iterator[FakeMaster]:
    master = FakeMaster()
    try:
        yield master
    finally:
        master.close()
