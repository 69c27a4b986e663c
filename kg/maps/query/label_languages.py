"""Label selection by language: a query gives one label for each thing, however many it has.

A header line ``labels: ontology category of class, map label of object`` says which variables of a
query are labels, of which thing, and in which graph. For each, a filter keeps the best label of the
thing: one in a language asked for, in order of preference; else one without a language, as the
shipped ontologies have; else an English one; else any. Of several the first by alphabet is kept.
Language ranges and their lookup: RFC 4647, section 3.4.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pyoxigraph import Literal

from kg.model.errors import QueryError, QueryParameterError

MAX_LANGUAGES: Final = 8  # of one preference; each makes the filter longer
_HEADER: Final = re.compile(r"(ontology|map) (\w+) of (\w+)")
_RANGE: Final = re.compile(
    r"\s*(\*|[A-Za-z]{1,8}(?:-[A-Za-z0-9]{1,8})*)\s*(?:;\s*q\s*=\s*(\d(?:\.\d*)?)\s*)?"
)


@dataclass(frozen=True, slots=True)
class LabelColumn:
    """A variable of a query that is the label of another one, both without ``?``."""

    graph: str  # "ontology" or "map"
    label: str
    thing: str

    def filter(self, languages: Sequence[str]) -> str:
        """A filter for the group of the variables, which keeps the best label; on one line."""
        own, other = f"?{self.label}", f"?{self.label}_other"
        mine, its = _rank(own, languages), _rank(other, languages)
        return (
            f" FILTER(IF(BOUND({own}), NOT EXISTS {{ GRAPH graph:{self.graph} "
            f"{{ ?{self.thing} rdfs:label {other} }} FILTER({other} != {own} && ({its} < {mine} || "
            f"{its} = {mine} && (STR({other}) < STR({own}) || "
            f"STR({other}) = STR({own}) && LANG({other}) < LANG({own})))) }}, true))"
        )


def label_columns(name: str, header: str) -> tuple[LabelColumn, ...]:
    """The columns in a header line of the query `name`; raises QueryError for another form."""
    columns = []
    for part in filter(None, (part.strip() for part in header.split(","))):
        match = _HEADER.fullmatch(part)
        if match is None:
            raise QueryError(
                f"{name}: labels must be 'ontology LABEL of THING' or 'map LABEL of THING', "
                f"got {part!r}"
            )
        columns.append(LabelColumn(*match.groups()))
    return tuple(columns)


def preferred_languages(text: str) -> tuple[str, ...]:
    """Languages in order of preference, from text such as ``de`` or ``de-AT, fr;q=0.5``.

    The syntax is that of Accept-Language (RFC 9110, section 12.5.4); a language with a region is
    followed by the language alone. Raises QueryParameterError for text of another form.
    """
    weighed = []
    for part in filter(str.strip, text.split(",")):
        match = _RANGE.fullmatch(part)
        if match is None:
            raise QueryParameterError(
                f"a language is written de, en-GB or de, fr;q=0.5; got {text[:60]!r}"
            )
        weighed.append((match[1].lower(), float(match[2] or 1)))
    ordered = sorted((one for one in weighed if one[1] > 0), key=lambda one: -one[1])
    found: dict[str, None] = {}
    for language, _ in ordered[:MAX_LANGUAGES]:
        if language != "*":
            found |= dict.fromkeys((language, language.partition("-")[0]))
    return tuple(found)


def _rank(variable: str, languages: Sequence[str]) -> str:
    """SPARQL expression of the rank of a label; the lowest is the best."""
    tests = [f"LANGMATCHES(LANG({variable}), {Literal(one)})" for one in languages]
    tests += [f'LANG({variable}) = ""', f'LANGMATCHES(LANG({variable}), "en")']
    expression = str(len(tests))
    for rank, test in reversed([*enumerate(tests)]):
        expression = f"IF({test}, {rank}, {expression})"
    return expression
