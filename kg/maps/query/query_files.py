"""Query files: a header that documents the question, checked parameters, a table back.

    #+ summary: Objects within a distance of a point
    #+ parameters:
    #+   x (double): of the point [m]
    #+   radius (double = 2.0): distance [m]
    #+ columns: object, category, x, y, z
    #+ asked: what is near the table? / things around the bed
    #+ answer: lookup
    #+ labels: ontology category of class
    #+ cells: disc x y radius
    SELECT ?object ... WHERE { GRAPH graph:map { ?object here:inCell ?cell ... } ... }

`$name` is a parameter and `?name` a variable; they are distinct even if the names are equal. A
``cells`` line names the parameters of an area (``disc x y radius`` or ``box xmin xmax ymin ymax``).
With it the loader begins the pattern with ``VALUES ?cell {...}``, the grid cells that the area
touches, which makes the query faster and leaves its result unchanged. A ``labels`` line names the
variables that are labels, each with its graph and its thing; a thing gets one label, however many
it has (`kg.maps.query.parameter_resolution`). `answer` is the cost class of a query: the cost of a
``lookup`` depends on the rows it returns, not on the size of the map; a ``listing`` returns all
things of a kind; a ``survey`` scans the map.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from pyoxigraph import Literal, NamedNode

from kg.maps.query.evaluation import Table
from kg.maps.query.parameter_resolution import LabelColumn, label_columns, preferred_languages
from kg.model import vocabulary as v
from kg.model.errors import QueryError, QueryParameterError, UnknownQueryError, did_you_mean
from kg.model.regular_files import read_text
from kg.model.resources import QUERIES
from kg.rdf.literals import cells_of_box, cells_of_disc
from kg.rdf.sparql.lexer import (
    Term,
    insert_into_pattern,
    parameters_in,
    substitute,
    variables_in,
)

#: (parameter type, text) -> IRI; raises HereaboutsError for names that the map lacks.
#: ("size", category) -> length in metres, as text
Resolver = Callable[[str, str], str]

ANSWERS = ("lookup", "listing", "survey")
_TYPES = ("category", "place", "iri", "string", "double", "integer")
LIKE_AN_IRI = re.compile(r"(https?://|urn:)\S+$")
_HEADER = re.compile(
    r"#\+ ?(?P<indent>\s*)(?P<key>[\w-]+)(?P<type>\s*\([^)]*\))?\s*:\s*(?P<text>.*)"
)
_SIZE_OF = re.compile(r"size of (\w+)")
_FORMS = ("select ", "ask ", "construct ", "describe ", "prefix ", "base ")
_AREAS: dict[str, tuple[Callable[..., tuple[str, ...] | None], int]] = {
    "disc": (cells_of_disc, 3),
    "box": (cells_of_box, 4),
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a query; it must be given if it has no `default`."""

    name: str
    type: str  # category, place, iri, string, double or integer
    default: str | None
    about: str

    def term(self, value: object, resolve: Resolver) -> Term:
        """The RDF term for a given value; raises QueryParameterError for one of the wrong type."""
        if self.type == "double":
            return Literal(self._double(value))
        if self.type == "integer":
            return Literal(self._integer(value))
        if not isinstance(value, str | int) or isinstance(value, bool):
            raise QueryParameterError(f"{self.name} must be a text, got {value!r}")
        if self.type == "string":
            return Literal(str(value))
        return self._iri(str(value), resolve)

    def _double(self, value: object) -> float:
        try:
            number = float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if isinstance(value, bool) or not math.isfinite(number):
            raise QueryParameterError(f"{self.name} must be a number, got {value!r}")
        return number

    def _integer(self, value: object) -> int:
        number = self._double(value)
        if number != int(number):
            raise QueryParameterError(f"{self.name} must be a whole number, got {value!r}")
        return int(number)

    def _iri(self, text: str, resolve: Resolver) -> NamedNode:
        prefix, colon, local = text.partition(":")
        if self.type != "iri":
            return NamedNode(resolve(self.type, text))
        is_name = colon and prefix in v.PREFIXES
        whole = v.PREFIXES[prefix] + local if is_name else resolve(self.type, text)
        try:
            return NamedNode(whole)
        except ValueError as error:
            raise QueryParameterError(
                f"{self.name} must be an IRI such as object/1, here:Chair or http://..., "
                f"got {text!r}"
            ) from error


@dataclass(frozen=True, slots=True)
class ParameterizedQuery:
    """Parameterized query of a query file, with its documented parameters and columns."""

    name: str
    summary: str
    parameters: tuple[Parameter, ...]
    columns: tuple[str, ...]
    cells: tuple[str, ...]  # area and its parameters, e.g. ("disc", "x", "y", "radius"); or empty
    sparql: str
    asked: tuple[str, ...] = ()  # plain questions that it answers
    answer: str = ""  # lookup, listing or survey; empty where the header has none
    measures: bool = False  # whether it compares coordinates, which need one frame
    labels: tuple[LabelColumn, ...] = ()  # variables that are labels of things
    shipped: bool = False  # whether it came with hereabouts, and is no text from outside

    def bind(self, values: Mapping[str, object], resolve: Resolver, language: str = "") -> str:
        """The query text with its parameters put in as RDF terms.

        `language` is that of labels (`label_languages.preferred_languages`). Raises
        QueryParameterError where a parameter is missing, unknown or of the wrong type.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        for name in values:
            if name not in known:
                raise QueryParameterError(self._unknown(name))
        terms = {name: self._term(known[name], values, resolve) for name in known}
        dollars = parameters_in(self.sparql)
        rows = "".join(  # a parameter written ?name is a variable with one value
            f" VALUES ?{name} {{ ${name} }}" for name in terms if name not in dollars
        )
        languages = preferred_languages(language)
        filters = "".join(column.filter(languages) for column in self.labels if not column.every)
        minus = "".join(column.minus(languages) for column in self.labels if column.every)
        # terms are put in last: the tokens of the rest are kept for the next call
        first = rows + self._cell_values(terms) + filters
        return substitute(insert_into_pattern(self.sparql, first, minus), terms)

    def check(self, answer: Table) -> Table:
        """`answer` itself; raises QueryError where its columns are not those of the header."""
        if self.columns and answer.columns != self.columns:
            raise QueryError(
                f"{self.name}: the header promises the columns {', '.join(self.columns)}, "
                f"the query gives {', '.join(answer.columns)}"
            )
        return answer

    def _term(self, parameter: Parameter, values: Mapping[str, object], resolve: Resolver) -> Term:
        value = values.get(parameter.name, parameter.default)
        if value is parameter.default and (of := _SIZE_OF.fullmatch(str(value))):
            value = resolve("size", str(values.get(of[1])))
        if value is None:
            about = f": {parameter.about}" if parameter.about else ""
            raise QueryParameterError(
                f"{self.name} needs {parameter.name} ({parameter.type}{about})"
            )
        return parameter.term(value, resolve)

    def _unknown(self, name: str) -> str:
        known = [parameter.name for parameter in self.parameters]
        takes = f"it takes: {', '.join(known)}" if known else "it takes none"
        return f"{self.name} has no parameter {name!r}; {takes}{did_you_mean(name, known)}"

    def _cell_values(self, terms: Mapping[str, Term]) -> str:
        if not self.cells:
            return ""
        area, *names = self.cells
        cells = _AREAS[area][0](*(float(terms[name].value) for name in names))
        if cells is None:
            return ""
        return f" VALUES ?cell {{ {' '.join(str(NamedNode(cell)) for cell in cells)} }}"


def load_query(path: Path | str) -> ParameterizedQuery:
    """The query in a file; raises QueryError if that is missing or malformed."""
    path = Path(path)
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise QueryError(f"cannot read the query file {path}: {error}") from error
    return parse_query_file(text, path.stem)


def parse_query_file(text: str, name: str) -> ParameterizedQuery:
    """The query in the text of a query file.

    Raises QueryError where the header is malformed or disagrees with the `$names` of the query.
    """
    fields: dict[str, str] = {}
    parameters: list[Parameter] = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("#+"):
            continue
        match = _HEADER.fullmatch(line.rstrip())
        if match is None:
            raise QueryError(f"{name}: line {number} is no header line: {line.strip()!r}")
        if match["indent"]:
            parameters.append(_parameter(name, match))
        else:
            fields[match["key"]] = match["text"]
    question = ParameterizedQuery(
        name=name,
        summary=fields.get("summary", ""),
        parameters=tuple(parameters),
        columns=tuple(column.strip() for column in fields.get("columns", "").split(",") if column),
        cells=tuple(fields.get("cells", "").split()),
        sparql=text,
        asked=tuple(part.strip() for part in fields.get("asked", "").split("/") if part.strip()),
        answer=fields.get("answer", ""),
        labels=label_columns(name, fields.get("labels", "")),
        measures="cells" in fields or "measures" in fields,
    )
    _check_header(question)
    return question


def inline_query(sparql: str, values: Mapping[str, object]) -> ParameterizedQuery:
    """The query in a text. Without a header, the values determine the types of parameters.

    Text that starts like ``http://``, ``urn:`` or a prefix such as ``here:`` is an IRI, other text
    a string.
    """
    if any(line.startswith("#+") for line in sparql.splitlines()):
        return parse_query_file(sparql, "query")
    parameters = tuple(Parameter(name, _type_of(value), None, "") for name, value in values.items())
    question = ParameterizedQuery("query", "", parameters, (), (), sparql)
    _check_header(question)
    return question


def resolve_query(
    question: str | Path | ParameterizedQuery, values: Mapping[str, object]
) -> ParameterizedQuery:
    """The shipped query of a name, or the query in a ``.rq`` file or in SPARQL text."""
    if isinstance(question, ParameterizedQuery):
        return question
    text = str(question)
    if isinstance(question, Path) or (text.endswith(".rq") and "\n" not in text):
        return load_query(question)
    if "{" in text or "<" in text or text.casefold().startswith(_FORMS):
        return inline_query(text, values)
    return find_query(text)


def shipped_queries() -> tuple[ParameterizedQuery, ...]:
    """All shipped queries, by name."""
    return tuple(map(_shipped, shipped_names()))


@cache
def shipped_names() -> tuple[str, ...]:
    """The names of all shipped queries."""
    return tuple(sorted(path.stem for path in QUERIES.glob("*.rq")))


def find_query(name: str) -> ParameterizedQuery:
    """The shipped query called `name`; UnknownQueryError, with a near name, if none is."""
    names = shipped_names()
    if name not in names:
        near = did_you_mean(name, names)
        raise UnknownQueryError(
            f"no query {name[:60]!r}{near}{'' if near else ';'} `hereabouts queries` lists them"
        )
    return _shipped(name)


@cache
def _shipped(name: str) -> ParameterizedQuery:
    # cached: shipped files do not change while a program runs, and some run often
    return replace(load_query(QUERIES / f"{name}.rq"), shipped=True)


def _type_of(value: object) -> str:
    if isinstance(value, int):
        return "integer"
    if isinstance(value, float):
        return "double"
    prefix, colon, _ = str(value).partition(":")
    is_name = colon and prefix in v.PREFIXES
    return "iri" if is_name or LIKE_AN_IRI.match(str(value)) else "string"


def _parameter(question: str, match: re.Match[str]) -> Parameter:
    inside = (match["type"] or "").strip().strip("()")
    kind, equals, default = (part.strip() for part in inside.partition("="))
    if kind not in _TYPES:
        raise QueryError(
            f"{question}: parameter {match['key']} has no type {kind!r}; "
            f"there are: {', '.join(_TYPES)}"
        )
    return Parameter(match["key"], kind, default.strip("\"'") if equals else None, match["text"])


def _check_header(question: ParameterizedQuery) -> None:
    declared = {parameter.name for parameter in question.parameters}
    used = parameters_in(question.sparql)
    for name in sorted(used - declared):
        raise QueryError(
            f"{question.name}: ${name} has neither a value nor a line under '#+ parameters:'; "
            f"write ?{name} for a variable"
        )
    for name in sorted(declared - used - variables_in(question.sparql)):
        raise QueryError(
            f"{question.name}: the parameter {name} is declared but neither ${name} nor ?{name} is "
            "used"
        )
    if question.answer not in ("", *ANSWERS):
        raise QueryError(
            f"{question.name}: an answer is a {', a '.join(ANSWERS[:-1])} or a {ANSWERS[-1]}, "
            f"got {question.answer!r}"
        )
    if question.cells:
        area, *names = question.cells
        if area not in _AREAS or len(names) != _AREAS[area][1] or not declared.issuperset(names):
            raise QueryError(
                f"{question.name}: cells must be 'disc X Y RADIUS' or 'box XMIN XMAX YMIN YMAX' "
                f"over its own parameters, got '{' '.join(question.cells)}'"
            )
