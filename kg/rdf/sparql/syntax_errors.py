"""Syntax errors of the engine's SPARQL parser as one line of text that names the cause.

The parser lists what it expected at the first character that fits no rule. That is rarely the
cause: a prefix without declaration, a name without prefix, a misspelt keyword, a missing bracket.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from kg.model import vocabulary as v
from kg.model.errors import did_you_mean
from kg.rdf.sparql.lexer import Token, tokens_of

MAX_ALTERNATIVES: Final = 6  # expected tokens in a message; the engine lists all

_BRACKETS: Final = {"{": "}", "(": ")", "[": "]"}
_FORMS: Final = (
    *("SELECT", "ASK", "CONSTRUCT", "DESCRIBE", "PREFIX", "BASE", "INSERT", "DELETE", "WITH"),
    *("CLEAR", "DROP", "CREATE", "ADD", "COPY", "MOVE", "LOAD"),
)
_KEYWORDS: Final = (
    *_FORMS,
    *("WHERE", "FROM", "NAMED", "GRAPH", "OPTIONAL", "UNION", "MINUS", "FILTER", "BIND", "VALUES"),
    *("SERVICE", "SILENT", "DISTINCT", "REDUCED", "ORDER", "GROUP", "HAVING", "BY", "ASC", "DESC"),
    *("LIMIT", "OFFSET", "EXISTS", "NOT", "IN", "AS", "UNDEF", "DATA", "USING", "COUNT", "SUM"),
    *("AVG", "MIN", "MAX", "SAMPLE", "GROUP_CONCAT", "SEPARATOR", "REGEX", "CONTAINS", "BOUND"),
    *("STRSTARTS", "STRENDS", "LANG", "LANGMATCHES", "DATATYPE", "IF", "COALESCE", "STR", "IRI"),
    *("TRUE", "FALSE", "A", "CONCAT", "STRLEN", "LCASE", "UCASE", "ABS", "ROUND", "NOW", "YEAR"),
)
#: prefixes of vocabularies that maps do not use and queries elsewhere often do
_ELSEWHERE: Final = {
    "wd": "http://www.wikidata.org/entity/",
    "wdt": "http://www.wikidata.org/prop/direct/",
    "schema": "https://schema.org/",
    "foaf": "http://xmlns.com/foaf/0.1/",
    "dcterms": "http://purl.org/dc/terms/",
    "dc": "http://purl.org/dc/elements/1.1/",
    "sh": "http://www.w3.org/ns/shacl#",
    "sf": "http://www.opengis.net/ont/sf#",
    "time": "http://www.w3.org/2006/time#",
}


def explained(
    sparql: str, message: str, shift: int = 0, terms: Callable[[], Iterable[str]] = tuple
) -> str:
    """The parser's message about a text with its place and cause.

    Line 1 of the parsed text had `shift` columns of prologue. `terms` returns IRIs that a name
    without a prefix may mean.
    """
    place, _, reason = message.removeprefix("error at ").partition(": ")
    line, colon, column = place.partition(":")
    if not (colon and line.isdigit() and column.isdigit()):
        return " ".join(message.split())
    at = max(int(column) - (shift if line == "1" else 0), 1)
    offset = sum(len(row) for row in sparql.splitlines(keepends=True)[: int(line) - 1]) + at - 1
    tokens = list(tokens_of(sparql))
    cause = (
        _undeclared_prefix(tokens, reason)
        or _first_word(tokens)
        or _word(tokens, offset, terms)
        or _unclosed(sparql, tokens)
        or _expected(reason)
    )
    return f"does not parse at line {line}, column {at}: {cause}"


def _undeclared_prefix(tokens: list[Token], reason: str) -> str:
    if "Prefix not found" not in reason:
        return ""
    declared = [
        after.text.rstrip(":")
        for token, after in zip(tokens, tokens[1:], strict=False)
        if token.keyword == "PREFIX"
    ]
    known = {*declared, *v.PREFIXES}
    used = (token.text.partition(":")[0] for token in tokens if token.kind == "name")
    prefix = next((name for name in used if name not in known), "")
    namespace = _ELSEWHERE.get(prefix)
    near = "" if namespace else did_you_mean(f"{prefix}:", [f"{name}:" for name in known])
    return (
        f"the prefix {prefix}: is not declared{near}; the query may begin with "
        f"PREFIX {prefix}: <{namespace or 'IRI'}>"
    )


def _first_word(tokens: list[Token]) -> str:
    """The cause, where a text begins with none of the words that it may begin with."""
    first = tokens[0] if tokens else None
    if first is not None and first.kind == "word" and first.keyword not in _FORMS:
        return f"it begins with {first.text!r}{did_you_mean(first.text, _FORMS)}"
    return ""


def _word(tokens: list[Token], offset: int, terms: Callable[[], Iterable[str]]) -> str:
    """The cause, where the parser stopped at a word that is no keyword."""
    before = [token for token in tokens if token.start <= offset and token.kind == "word"]
    if not before or before[-1].end + 1 < offset or before[-1].keyword in _KEYWORDS:
        return ""
    word = before[-1].text
    if word.isdigit():
        return ""
    # of two terms with one name, ours
    known = sorted(terms(), key=lambda iri: (iri.startswith(v.HERE), iri))
    names = {v.local_name(iri): v.curie(iri) for iri in known if not v.curie(iri).startswith("<")}
    exact = {name.lower(): text for name, text in names.items()}.get(word.lower())
    near = f"; did you mean {exact}?" if exact else did_you_mean(word, _KEYWORDS)
    near = near or did_you_mean(word, names)
    forms = '; terms are prefix:name, <IRI>, ?variable or "text"'
    return f"{word!r} is neither a keyword nor a term{near or forms}"


def _unclosed(sparql: str, tokens: list[Token]) -> str:
    """The cause, where a bracket or a string is not closed, or a bracket closes nothing."""
    opened: list[Token] = []
    for token in tokens:
        if token.kind == "other" and token.text in "\"'":
            return f"the string that begins at {_place(sparql, token)} is not closed"
        if token.kind != "mark" or token.text == ";":
            continue
        if token.text in _BRACKETS:
            opened.append(token)
        elif opened and _BRACKETS[opened[-1].text] == token.text:
            opened.pop()
        else:
            return f"the {token.text} at {_place(sparql, token)} closes nothing"
    if opened:
        last = opened[-1]
        return (
            f"the {last.text} at {_place(sparql, last)} is not closed; "
            f"a {_BRACKETS[last.text]} is missing"
        )
    return ""


def _place(sparql: str, token: Token) -> str:
    before = sparql[: token.start]
    return f"line {before.count(chr(10)) + 1}, column {token.start - before.rfind(chr(10))}"


def _expected(reason: str) -> str:
    """What the parser expected, without its classes of characters."""
    options = reason.removeprefix("expected one of ").removeprefix("expected ").split(", ")
    readable = [option for option in options if not option.startswith("[") and " | " not in option]
    if not reason.startswith("expected") or not readable:
        return " ".join(reason.split())[:200]
    more = ", ..." if len(readable) > MAX_ALTERNATIVES else ""
    return f"expected {', '.join(readable[:MAX_ALTERNATIVES])}{more}"
