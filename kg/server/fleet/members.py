"""The members of a fleet: folders read through killable workers, servers asked over HTTP."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

from kg.endpoint import is_url, without_secrets
from kg.engine import Engine
from kg.errors import (
    GraphError,
    HereaboutsError,
    HistoryError,
    InvalidFactError,
    QueryTimeoutError,
    UnreachableError,
)
from kg.identity import identity
from kg.remote import RemoteEngine
from kg.semantic_map import SemanticMap
from kg.served import Served, served_at
from kg.server.assertions import full_iri
from kg.server.bodies import Parameters
from kg.server.media_types import SOLUTIONS
from kg.server.moments import sequence_at
from kg.server.past import JSON, tell
from kg.server.settings import Limits
from kg.store import MapStore
from kg.wire import assertion_to_json
from kg.workers.pool import QueryPool

TRIPLES = "application/n-triples"
#: what members are asked for: both can be put together again
ACCEPT = f"{SOLUTIONS}, {TRIPLES}"
THREADS = 4  # questions to one member that may block at once
MARGIN = 1.0  # [s] beyond a query's limit until a member is given up

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Asked:
    """A query, and the graphs that its request names."""

    sparql: str
    default_graphs: tuple[str, ...] = ()
    named_graphs: tuple[str, ...] = ()
    at: str | None = None  # the time that is asked about, ISO 8601; None: now


class _Open(Protocol):
    """A member that is there."""

    base: str
    title: str

    @property
    def engine(self) -> Engine:
        """Its store, to look things up in."""

    async def ask(self, asked: Asked) -> bytes:
        """The answer, as JSON results or N-Triples."""

    async def tell(self, what: str, given: Parameters, media_type: str) -> tuple[str, bytes]:
        """Its assertions (JSON), log, diff or why: media type and body."""

    def close(self) -> None:
        """Let go of it."""


class _Folder:
    """A map in a folder, read here."""

    def __init__(self, path: str, limits: Limits) -> None:
        self._map = SemanticMap.open(path, read_only=True)
        self.base, self.title = self._map.base, self._map.title
        try:
            self._pool = QueryPool(
                self._map,
                workers=limits.workers,
                timeout=limits.query_seconds,
                memory_mb=limits.query_memory,
                max_result_bytes=limits.result,
            )
        except BaseException:
            self._map.close()
            raise

    @property
    def engine(self) -> Engine:
        return self._map.engine

    async def ask(self, asked: Asked) -> bytes:
        at = None if asked.at is None else await sequence_at(self._map, asked.at)
        answer = await self._pool.run_async(
            asked.sparql,
            accept=ACCEPT,
            default_graphs=asked.default_graphs,
            named_graphs=asked.named_graphs,
            base=self.base,
            at=at,
        )
        return answer.body

    async def tell(self, what: str, given: Parameters, media_type: str) -> tuple[str, bytes]:
        if what == "assertions":
            return JSON, await asyncio.to_thread(self._said, given)
        answer = await tell(self._pool, self._map, what, given, media_type)
        return answer.media_type, answer.body

    def _said(self, given: Parameters) -> bytes:
        iri = given.one("iri")
        found = self._map.assertions(None if iri is None else full_iri(self.base, iri))
        if given.flag("conflicts"):
            found = tuple(said for said in found if said.since is not None)
        return json.dumps({"assertions": [assertion_to_json(said) for said in found]}).encode()

    def close(self) -> None:
        self._pool.close()
        self._map.close()


class _Server:
    """A map on a SPARQL server."""

    def __init__(self, address: str, limits: Limits, threads: ThreadPoolExecutor) -> None:
        self._address, self._limits, self._threads = address, limits, threads
        self._store = MapStore.connect(address, read_only=True)
        try:
            self.base, self.title = identity(self._store)
            self._served = served_at(self._store)
        except BaseException:
            self._store.close()
            raise

    @property
    def engine(self) -> Engine:
        return self._store.engine

    async def ask(self, asked: Asked) -> bytes:
        return await asyncio.get_running_loop().run_in_executor(self._threads, self._fetch, asked)

    def _fetch(self, asked: Asked) -> bytes:
        engine, limits = self._store.engine, self._limits
        assert isinstance(engine, RemoteEngine)
        if asked.at is not None:
            self._refuse_plain("keeps no past")
        _, body = engine.fetch(
            asked.sparql,
            asked.default_graphs,
            asked.named_graphs,
            base=self.base,
            at=asked.at,
            seconds=limits.query_seconds,
            most=limits.result,
        )
        return body

    async def tell(self, what: str, given: Parameters, media_type: str) -> tuple[str, bytes]:
        act = partial(self._tell, what, given, media_type)
        return await asyncio.get_running_loop().run_in_executor(self._threads, act)

    def _tell(self, what: str, given: Parameters, media_type: str) -> tuple[str, bytes]:
        served = self._refuse_plain(f"tells no /{what}")
        limits = self._limits
        return served.fetch(
            what, given.pairs, media_type, seconds=limits.query_seconds, most=limits.result
        )

    def _refuse_plain(self, why: str) -> Served:
        """The member, where it is a running `hereabouts serve`; HistoryError where it is none."""
        if self._served is None:
            where = without_secrets(self._address)
            raise HistoryError(f"{where} is a plain SPARQL server: it {why}")
        return self._served

    def close(self) -> None:
        self._store.close()


class Member:
    """One member's seat, whether it is there or away: opened when asked, again after it failed."""

    def __init__(self, address: str, limits: Limits) -> None:
        self.name = without_secrets(address) if is_url(address) else address
        self.away = ""  # why it did not answer the last time
        self._address, self._limits = address, limits
        self._guard = threading.Lock()
        self._open: _Open | None = None
        self._closed = False
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix="member")

    @property
    def known(self) -> tuple[str, str] | None:
        """IRI and title of its map, where it is open."""
        there = self._open
        return (there.base, there.title) if there else None

    def open(self) -> str:
        """Open it ahead of questions; why that fails, or an empty text."""
        try:
            self._get()
            self.away = ""
        except HereaboutsError as error:
            self.away = " ".join(str(error).split())
        return self.away

    async def ask(self, asked: Asked) -> bytes:
        """The whole answer; raises HereaboutsError where there is none within the limits."""
        return await self._bounded(lambda there: there.ask(asked))

    async def tell(self, what: str, given: Parameters, media_type: str) -> tuple[str, bytes]:
        """Its assertions (as JSON), log, diff or why; raises as `ask`, and what it refuses."""
        return await self._bounded(lambda there: there.tell(what, given, media_type))

    async def look_up(self, read: Callable[[_Open], T]) -> T:
        """What `read`, on a thread, makes of the open member."""
        loop = asyncio.get_running_loop()
        return await self._bounded(lambda there: loop.run_in_executor(self._threads, read, there))

    def close(self) -> None:
        """Let go of it, for good."""
        with self._guard:
            self._closed = True
            if self._open is not None:
                self._open.close()
                self._open = None
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _bounded(self, act: Callable[[_Open], Awaitable[T]]) -> T:
        seconds = self._limits.query_seconds
        try:
            async with asyncio.timeout(seconds + MARGIN):
                there = await asyncio.get_running_loop().run_in_executor(self._threads, self._get)
                answer = await act(there)
        except TimeoutError:
            self.away = f"no answer within {seconds:g} s"
            raise QueryTimeoutError(self.away) from None
        except (HistoryError, InvalidFactError):
            self.away = ""  # it is there, and says no
            raise
        except GraphError as error:
            self.away = " ".join(str(error).split())
            if isinstance(error, UnreachableError):
                await asyncio.to_thread(self._drop)
            raise
        self.away = ""
        return answer

    def _get(self) -> _Open:
        with self._guard:
            if self._closed:
                raise GraphError(f"{self.name} is closed")
            if self._open is None:
                self._open = (
                    _Server(self._address, self._limits, self._threads)
                    if is_url(self._address)
                    else _Folder(self._address, self._limits)
                )
            return self._open

    def _drop(self) -> None:
        with self._guard:
            if self._open is not None:
                self._open.close()
                self._open = None


async def ask_all(
    members: Sequence[Member], ask: Callable[[Member], Awaitable[T]]
) -> tuple[dict[str, T], dict[str, HereaboutsError]]:
    """The answers of those that answer, and the errors of those that do not, by name.

    Whoever cancels it cancels every question.
    """
    found = await asyncio.gather(*(_caught(ask(member)) for member in members))
    answers: dict[str, T] = {}
    errors: dict[str, HereaboutsError] = {}
    for member, (answer, error) in zip(members, found, strict=True):
        if error is not None:
            errors[member.name] = error
        else:
            answers[member.name] = answer  # type: ignore[assignment]
    return answers, errors


async def _caught(question: Awaitable[T]) -> tuple[T | None, HereaboutsError | None]:
    try:
        return await question, None
    except HereaboutsError as error:
        return None, error


def lines(errors: Mapping[str, HereaboutsError]) -> dict[str, str]:
    """Why each did not answer, in a line."""
    return {name: " ".join(str(error).split()) for name, error in errors.items()}
