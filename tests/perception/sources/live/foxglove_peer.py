"""A Foxglove WebSocket server, as its protocol has it."""

import json
import struct
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

from perception.sources.bags.bag_file import RawMessage


class FoxglovePeer:
    """Advertises channels of one encoding, and sends each to who subscribed to it."""

    def __init__(self, types: Mapping[str, str], encoding: str) -> None:
        self._channels = [
            {"id": 7 + i, "topic": topic, "encoding": encoding, "schemaName": type_, "schema": ""}
            for i, (topic, type_) in enumerate(types.items())
        ]
        self._subscribed: dict[str, tuple[ServerConnection, int]] = {}
        self.greeting: list[str | bytes] = []  # sent to who connects, before all else
        self.connections: list[ServerConnection] = []
        self.address = ""

    def handle(self, connection: ServerConnection) -> None:
        self.connections.append(connection)
        with suppress(ConnectionClosed):
            for each in self.greeting:
                connection.send(each)
            connection.send(json.dumps({"op": "serverInfo", "name": "peer", "capabilities": []}))
            connection.send(json.dumps({"op": "advertise", "channels": self._channels}))
            for text in connection:
                self._told(connection, json.loads(text))

    def _told(self, connection: ServerConnection, told: dict[str, Any]) -> None:
        topics = {channel["id"]: str(channel["topic"]) for channel in self._channels}
        if told["op"] == "subscribe":
            for one in told["subscriptions"]:
                self._subscribed[topics[one["channelId"]]] = connection, one["id"]
        elif told["op"] == "unsubscribe":
            gone = set(told["subscriptionIds"])
            left = {k: v for k, v in self._subscribed.items() if v[1] not in gone}
            self._subscribed = left

    def wait_for(self, topics: Any, seconds: float = 20) -> None:
        until = time.monotonic() + seconds
        while not set(topics) <= self._subscribed.keys():
            assert time.monotonic() < until, f"nobody subscribed to {topics}"
            time.sleep(0.01)

    def hang_up(self) -> None:
        self._subscribed.clear()
        for connection in self.connections:
            connection.close()
        self.connections.clear()

    def publish(self, raw: RawMessage) -> None:
        connection, number = self._subscribed.get(raw.topic, (None, 0))
        if connection is not None:
            with suppress(ConnectionClosed):
                connection.send(struct.pack("<BIQ", 1, number, raw.time) + raw.data)


@contextmanager
def foxglove_peer(types: Mapping[str, str], encoding: str) -> Iterator[FoxglovePeer]:
    peer = FoxglovePeer(types, encoding)
    protocols = [Subprotocol("foxglove.websocket.v1")]
    with serve(peer.handle, "127.0.0.1", 0, subprotocols=protocols, compression=None) as server:
        peer.address = f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield peer
        server.shutdown()
        thread.join()
