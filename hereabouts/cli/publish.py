"""Mirror one or several maps live into a SPARQL server.

Shipped queries then run over all of them. Each map is copied once as a whole, then each transaction
as one update. A new run continues after the last transaction on the server. Maps of running servers
are followed until the command is interrupted; a folder is published as it is now.

example: hereabouts publish http://robot-1:8008 http://robot-2:8008 --to http://127.0.0.1:7878
"""

from __future__ import annotations

import argparse
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from hereabouts.cli.arguments import declare, end_on_signal
from hereabouts.cli.console import note, write_json

_OPTIONS = """
MAP ... -> maps    folder of a map, or address of `hereabouts serve`
--to URL           SPARQL server, e.g. http://127.0.0.1:7878
--token-file FILE  file that holds only the bearer token of that server
--once             publish the present state and end
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, to={"required": True})


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.publishing.publisher import Publisher
    from kg.serving.publishing.target import PublishTarget

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
