"""Parsing of ontology files; the syntax is detected by content, since Protege uses .owl for all.

Errors name the line, also for RDF/XML, whose parser does not report it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final
from xml.parsers import expat

from pyoxigraph import Quad, RdfFormat, parse

from kg.model.errors import OntologyError
from kg.model.regular_files import read_bytes

#: Message for RDF/XML with a DOCTYPE.
NO_LOADER: Final = "LoadDocumentCallback"  # in the parser's words on a remote @context
REMOTE_CONTEXT: Final = "a remote @context is not fetched; write the context into the document"
DOCUMENT_TYPE: Final = (
    "RDF/XML with a DOCTYPE is refused, since its entities can grow without limit; "
    "write IRIs in full, or use Turtle"
)
_DOCTYPE: Final = re.compile(rb"<!\s*(?:DOCTYPE|ENTITY)", re.IGNORECASE)
#: Endings of files that hold ontologies.
ENDINGS: Final = (".ttl", ".owl", ".rdf", ".nt", ".jsonld")
#: beginnings of documents in unsupported syntaxes
_FOREIGN: Final = {
    b"Prefix(": "OWL functional syntax",
    b"Ontology(": "OWL functional syntax",
    b"Prefix:": "Manchester syntax",
    b"Ontology:": "Manchester syntax",
    b"format-version:": "OBO",
}
_JSON: Final = re.compile(rb"\{|\[\s*[{\"]")  # no Turtle begins so
_BEFORE_ROOT: Final = re.compile(
    rb"\s+ | <\?.*?\?> | <!--.*?--> | <!DOCTYPE[^\[>]*(?:\[.*?\]\s*)?>", re.DOTALL | re.VERBOSE
)
_ROOT: Final = re.compile(rb"<(?:[\w.-]+:)?([\w.-]+)")


#: bytes of a document, its format -> quads; raises SyntaxError, or OntologyError for other failures
Parse = Callable[[bytes, RdfFormat], Iterable[Quad]]


def _parse_here(data: bytes, form: RdfFormat) -> Iterable[Quad]:
    return parse(data, format=form)


def parse_file(path: Path, parse: Parse = _parse_here) -> Iterator[Quad]:
    """The triples of an ontology file (Turtle, RDF/XML, N-Triples, JSON-LD), as quads.

    `parse` may run in another process (`kg.serving.workers.updates`).

    Raises:
        OntologyError: the file cannot be read or does not parse, is RDF/XML with a DOCTYPE, or
            has another syntax of OWL; the message has the line.
    """
    try:
        data = read_bytes(path)
    except OSError as error:
        raise OntologyError(f"{path}: {error.strerror or error}") from None
    form = _syntax(path, data.removeprefix(b"\xef\xbb\xbf"))
    if form == RdfFormat.RDF_XML and has_document_type(data):
        raise OntologyError(f"{path}: {DOCUMENT_TYPE}")
    try:
        yield from parse(data.removeprefix(b"\xef\xbb\xbf"), form)
    except SyntaxError as error:
        reason = re.sub(r"^Parser error[^:]*: ", "", error.msg or "it does not parse")
        number = error.lineno or _line(data, reason)
        line = f", line {number}" if number else ""
        if NO_LOADER in reason:
            reason = REMOTE_CONTEXT
        raise OntologyError(f"{path}{line}: {reason}") from None


def has_document_type(data: bytes) -> bool:
    """Whether an XML document has a DOCTYPE, in any encoding and at any position."""
    return _DOCTYPE.search(data.replace(b"\0", b"")) is not None


def _syntax(path: Path, data: bytes) -> RdfFormat:
    head = data.lstrip()
    for beginning, name in _FOREIGN.items():
        if head.startswith(beginning):
            raise _foreign(path, name)
    if re.match(rb"<(\?xml|!|[\w.-]+:RDF[\s>])", head):
        if _root(head) == b"Ontology":
            raise _foreign(path, "OWL/XML")
        return RdfFormat.RDF_XML
    if _JSON.match(head):
        return RdfFormat.JSON_LD
    return RdfFormat.N_TRIPLES if path.suffix == ".nt" else RdfFormat.TURTLE


def _root(head: bytes) -> bytes:
    at = 0
    while before := _BEFORE_ROOT.match(head, at):
        at = before.end()
    root = _ROOT.match(head, at)
    return root[1] if root else b""


def _foreign(path: Path, name: str) -> OntologyError:
    return OntologyError(
        f"{path}, line 1: this is {name}; save it as Turtle or RDF/XML (in Protege: File > Save as)"
    )


def _line(data: bytes, reason: str) -> int | None:
    """Line of the XML fault, or else of the text that the parser quotes."""
    try:
        expat.ParserCreate().Parse(data, True)
    except expat.ExpatError as error:
        return error.lineno
    for quoted in re.findall(r"['`<\"]([^'`<>\"]+)['`>\"]", reason):
        at = data.find(quoted.encode())
        if at >= 0:
            return data.count(b"\n", 0, at) + 1
    return None
