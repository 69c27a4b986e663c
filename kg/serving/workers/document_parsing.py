"""Parser of RDF files in an isolated worker, whose crash does not end this process."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable
from typing import Final, Self

from pyoxigraph import Quad, RdfFormat, parse

from kg.model.errors import OntologyError, QueryError, ShapeError
from kg.serving.workers.process import WorkerProcess, settings_of

SECONDS: Final = 60.0  # for one document
MEMORY: Final = 1024  # [MB]
RESULT: Final = 1 << 30  # [bytes] of N-Quads
_LINE: Final = re.compile(r"at line (\d+)")


class IsolatedParser:
    """Parses one document at a time; a `kg.rdf.parsing.Parse` and a context manager."""

    def __init__(self) -> None:
        self._worker: WorkerProcess | None = None

    def __call__(self, data: bytes, form: RdfFormat) -> Iterable[Quad]:
        """The quads; raises SyntaxError with the line, OntologyError if the worker ends."""
        if self._worker is None or not self._worker.alive:
            self.close()
            self._worker = WorkerProcess(settings_of(MEMORY))
        request = {
            "form": form.media_type,
            "base_iri": None,
            "body": base64.b64encode(data).decode("ascii"),
            "max_bytes": RESULT,
        }
        try:
            answer = self._worker.ask(request, SECONDS, b"L")
        except (QueryError, ShapeError) as error:
            raise _as_syntax_error(error) from error
        return parse(answer.body, format=RdfFormat.N_QUADS)

    def close(self) -> None:
        """End the worker."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _as_syntax_error(error: QueryError | ShapeError) -> Exception:
    message = str(error).removeprefix("the query cannot be answered: ")
    if type(error) is not QueryError:
        return OntologyError(message)
    # as the parser raises it in its own process
    found, line = SyntaxError(re.sub(r" \(line \d+\)$", "", message)), _LINE.search(message)
    found.lineno = int(line[1]) if line else None
    return found
