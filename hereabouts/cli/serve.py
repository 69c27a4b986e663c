"""Serve the map over HTTP: SPARQL, linked data, a web page, a feed of changes.

SPARQL 1.1 Protocol is at /sparql, graphs at /graphs, changes at /changes; each thing of the map is
a page and a document. Without a token file the server only reads.

example: hereabouts serve kitchen.map --token-file tokens.txt
"""

from __future__ import annotations

import argparse
import logging
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare, end_at_latest, end_on_signal, keep_seconds, positive
from hereabouts.cli.console import note, write_json
from hereabouts.cli.map_recording import check_unmapped, fitted
from hereabouts.cli.mapping_options import Inputs, add_all_arguments, open_inputs
from kg.model.errors import HereaboutsError

if TYPE_CHECKING:
    from hereabouts.display.viewers.viewer import Viewer
    from kg.maps.semantic_map import SemanticMap
    from kg.serving.server import Settings
    from mapping.runs.progress_report import FrameReport
    from perception.frames import Detections, Frame, SceneScores

_OPTIONS = """
MAP
--host HOST                  own address (default: 127.0.0.1)
--port N                     port (default: 8008; 0: a free one)
--token-file FILE            tokens to write: lines of NAME TOKEN (default: read only)
--read-token-file FILE       tokens to read a private map: lines of NAME TOKEN (default: all may
                             read)
--public-host NAME ...       host name of this server for other machines (repeatable)
--trusted-proxy ADDRESS ...  reverse proxy, whose X-Forwarded-For names the client (repeatable)
--allow-origin ORIGIN ...    scripts of pages from ORIGIN may use the server; *: all may read
                             (repeatable)
--allow-service URL ...      SPARQL endpoint that queries may ask by SERVICE (repeatable)
--public                     serve other machines without a token file: everybody there may read
--timeout S                  limit of a query (default: 10)
--foxglove PORT              also serve Foxglove, to this machine alone: ws://127.0.0.1:PORT (0: a
                             free one)
--keep DURATION              length of the history to keep: 30d, 12h, 90m, 2w or 1y (default: all of
                             the past; the rest is dropped while serving)
--verbose                    print each request on stderr
--recording DIR ...          map this recording while serving (repeatable; one after the other)
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(
        parser,
        _OPTIONS,
        host={"default": "127.0.0.1"},
        port={"type": _port, "default": 8008},
        timeout={"type": positive, "default": 10.0},
        foxglove=_port,
    )
    add_all_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    if arguments.keep is not None and not (arguments.token_file or arguments.recording):
        arguments.usage_error("--keep needs a map that is written: --token-file or --recording")
    if arguments.foxglove is not None and arguments.read_token_file:
        arguments.usage_error("--foxglove would show a private map to anybody on this machine")
    signal.signal(signal.SIGTERM, end_on_signal)
    from kg.model.platforms import gc_frozen
    from kg.serving.opening import open_map, open_or_create_map
    from kg.serving.server import MapServer
    from kg.serving.workers.isolation import hide_memory
    from planner.questions.answers import answer_box

    hide_memory()
    settings, keep = _settings(arguments), keep_seconds(arguments)
    # errors come before any change of the map
    inputs = [open_inputs(arguments, folder) for folder in arguments.recording]
    if arguments.verbose:
        logging.basicConfig(level=logging.INFO, format="%(message)s")
    path = Path(arguments.map)
    # a server that only reads leaves the map to other readers
    opened = (
        open_or_create_map(path, title=path.stem)
        if inputs
        else open_map(path, read_only=not settings.tokens, exclusive=True)
    )
    with (
        opened as semantic_map,
        gc_frozen(),
        _foxglove(semantic_map, arguments) as viewer,
        _Mapper(semantic_map, arguments.map, inputs, viewer) as mapper,
    ):
        if keep is not None:
            semantic_map.history.retain(keep)
        planner = partial(answer_box, semantic_map)
        server = MapServer(semantic_map, settings, status=mapper.status, planner=planner)
        access = "reading and writing" if settings.tokens else "reading only"
        note(f"{semantic_map.description.title} at {server.url} ({access}); Ctrl+C ends")
        for warning in server.confinement.warnings():
            note(warning)
        mapper.start()
        server.run(on_signal=end_at_latest)
    return 0


@contextmanager
def _foxglove(semantic_map: SemanticMap, arguments: argparse.Namespace) -> Iterator[Viewer | None]:
    """The Foxglove server of `--foxglove`, fed with every change of the map."""
    if arguments.foxglove is None:
        yield None
        return
    from hereabouts.display.viewers.viewer import require

    require("foxglove", "foxglove")
    from hereabouts.display.viewers.feed import LiveFeed
    from hereabouts.display.viewers.foxglove_viewer import FoxgloveServer

    server = FoxgloveServer(semantic_map.description.title, "127.0.0.1", arguments.foxglove)
    with LiveFeed(semantic_map, server, server.subscribed):
        note(f"Foxglove at {server.url}")
        yield server


def _settings(arguments: argparse.Namespace) -> Settings:
    from kg.serving.server import BearerTokens, Limits, Settings

    return Settings(
        host=arguments.host,
        port=arguments.port,
        tokens=BearerTokens.load(arguments.token_file) if arguments.token_file else BearerTokens(),
        read_tokens=(
            BearerTokens.load(arguments.read_token_file)
            if arguments.read_token_file
            else BearerTokens()
        ),
        public_hosts=tuple(arguments.public_host),
        trusted_proxies=tuple(arguments.trusted_proxy),
        allow_origins=tuple(arguments.allow_origin),
        services=tuple(arguments.allow_service),
        public=arguments.public,
        limits=Limits(query_seconds=arguments.timeout),
    )


def _port(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) < 65536):
        raise argparse.ArgumentTypeError(f"needs a port between 0 and 65535, got {text!r}")
    return int(text)


class _Mapper:
    """Maps recordings on a thread of its own; leaving the context ends it after a whole frame."""

    def __init__(
        self, semantic_map: SemanticMap, address: str, inputs: list[Inputs], viewer: Viewer | None
    ) -> None:
        self._map, self._address = semantic_map, address
        self._inputs, self._viewer = inputs, viewer
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._map_all, name="hereabouts-mapper", daemon=True)
        self._progress: dict[str, object] = {}

    def start(self) -> None:
        """Begin, if there is a recording to map."""
        if self._inputs:
            self._thread.start()

    def status(self) -> Mapping[str, object]:
        """The progress of each recording, for `/health`."""
        return {"mapping": dict(self._progress)} if self._inputs else {}

    def __enter__(self) -> _Mapper:
        return self

    def __exit__(self, *exception: object) -> None:
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()

    def _map_all(self) -> None:
        for inputs in self._inputs:
            name = inputs.recording.name
            try:
                self._map_one(inputs)
            except _EndedError:
                return
            except HereaboutsError as error:
                # the other recordings and the server go on
                self._progress[name] = "failed; see the server's stderr"
                note(f"{name}: {error}")

    def _map_one(self, inputs: Inputs) -> None:
        from mapping.recording_mapper import map_recording

        if inputs.corrected:
            check_unmapped(inputs, self._map)
        inputs = fitted(inputs, self._map, self._address)
        name = inputs.recording.name

        def on_frame(report: FrameReport) -> None:
            self._progress[name] = {"frame": report.index + 1, "of": report.total}
            if self._end.is_set():
                raise _EndedError

        report = map_recording(
            inputs.recording,
            self._map,
            inputs.networks.detector,
            inputs.networks.scene,
            inputs.options,
            on_frame=on_frame,
            on_detections=None if self._viewer is None else self._on_detections,
        )
        self._progress[name] = (
            f"done: {report.frames} frames mapped, {report.skipped} were mapped before"
        )
        note(f"{name}: {report.frames} frames mapped, {report.objects} objects")

    def _on_detections(
        self, frame: Frame, detections: Detections, scores: SceneScores | None
    ) -> None:
        from hereabouts.display.viewers.feed import show_frame

        if self._viewer is not None:
            show_frame(self._viewer, frame, detections)


class _EndedError(Exception):
    """The server ends: stop the mapping after a whole frame."""


_PUBLISH_OPTIONS = """
MAP ... -> maps    folder of a map, or address of `hereabouts serve`
--to URL           SPARQL server, e.g. http://127.0.0.1:7878
--token-file FILE  file that holds only the bearer token of that server
--once             publish the present state and end
--json
"""


def add_publish(parser: argparse.ArgumentParser) -> None:
    declare(parser, _PUBLISH_OPTIONS, to={"required": True})


def publish(arguments: argparse.Namespace) -> int:
    """Mirror one or several maps live into a SPARQL server.

    Shipped queries then run over all of them. Each map is copied once as a whole, then each
    transaction as one update. A new run continues after the last transaction on the server. Maps of
    running servers are followed until the command is interrupted; a folder is published as it is
    now.

    example: hereabouts publish http://robot-1:8008 http://robot-2:8008 --to http://127.0.0.1:7878
    """
    from kg.serving.publishing import Publisher, PublishTarget

    token = _token(arguments.token_file) if arguments.token_file else None
    target = PublishTarget(arguments.to, token)
    publishers = [Publisher(address, target, note) for address in dict.fromkeys(arguments.maps)]
    signal.signal(signal.SIGTERM, end_on_signal)
    with ThreadPoolExecutor(len(publishers)) as pool:
        try:
            runs = [p.publish if arguments.once else p.follow for p in publishers]
            done = list(pool.map(_published, runs, [p.address for p in publishers]))
        finally:
            for publisher in publishers:
                publisher.stop()
    target.close()
    if arguments.json:
        write_json([{"map": p.address, "sequence": p.acknowledged} for p in publishers])
    return 0 if all(done) else 1


def _published(publish: Callable[[], object], address: str) -> bool:
    from kg.model.errors import HereaboutsError

    try:
        publish()
    except HereaboutsError as error:
        note(f"error: {address}: {error}")
        return False
    return True


def _token(file: str) -> str:
    from kg.model.errors import ServerError
    from kg.store.credentials import read_token_file

    token = read_token_file(file).strip()
    if not token or len(token.split()) != 1 or not token.isascii():
        raise ServerError(f"the token file {file} must hold one token alone")
    return token
