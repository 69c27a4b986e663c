"""Vetting of queries and updates before parsing, with clear error messages.

Oxigraph evaluates every SERVICE clause, and its recursive parser overflows the stack on a few
hundred nested brackets. Vetting rejects both. It is no security boundary: the kernel blocks the
network (`kg.serving.workers.isolation`); on machines where it cannot,
`check_network_words` rejects every suspicious text. Untrusted queries are vetted inside the worker,
so that a text that is slow to vet uses up its own time limit only.

Syntax errors name the cause. The parser lists what it expected at the first character that fits no
rule. That is rarely the cause: a prefix without declaration, a name without prefix, a misspelt
keyword, a missing bracket.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable
from itertools import pairwise
from typing import Final

from kg.model import vocabulary as v
from kg.model.errors import QueryError, QueryRefusedError, did_you_mean
from kg.rdf.sparql.lexer import Token, decode_escapes, keywords_of, tokens_of

_ALONE: Final = "SERVICE is refused: a query reads this map alone"
_JOINED: Final = "export the map and join it with the other source there"
MAX_LENGTH = 200_000  # characters; a VALUES of 2,000 IRIs is half of it
MAX_DEPTH = 100  # brackets; the parser's stack ends between 400 and 2,000

_GAP = r"(?:\s|\#[^\n\r]*[\n\r])*+"
# overlapping (a lookahead) and over the raw text with strings and comments, since the engine may
# read code in a part that the lexer reads as a string or a comment
_SERVICE = re.compile(
    rf"(?=service{_GAP}(?:silent{_GAP})?(?P<endpoint><[^>]*>|[?$]\w+|[^\s{{}}<>:]*:[^\s{{]*){_GAP}\{{)",
    re.IGNORECASE,
)
_LOAD = re.compile(rf"\bload{_GAP}(?:silent{_GAP})?(?:<[^>]*>|[\w.-]*:\w)", re.IGNORECASE)

_UPDATES = frozenset(
    ("INSERT", "DELETE", "LOAD", "CLEAR", "DROP", "CREATE", "ADD", "MOVE", "COPY", "WITH")
)


def check_unicode(text: str) -> None:
    """Raises QueryError if a text is not valid Unicode."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise QueryError(
            f"the query is no Unicode text: character {error.start} is half of a surrogate pair"
        ) from error


def check_length(sparql: str) -> None:
    """Raises QueryRefusedError if the text is too long."""
    if len(sparql) > MAX_LENGTH:
        raise QueryRefusedError(
            f"a query may have {MAX_LENGTH:,} characters, got {len(sparql):,}; split it"
        )


def vet(sparql: str, *, services: Collection[str] = ()) -> None:
    """Raises QueryRefusedError if the text writes, reads beyond the map, or nests too deeply.

    `services` are the IRIs that SERVICE may name. FROM only selects graphs of the map and needs no
    check.
    """
    check_no_update(sparql, hint="")
    check_nesting(sparql)
    for text in _readings(sparql):
        _check_services(text, services)


def reads_chosen_graphs(sparql: str) -> bool:
    """Whether the text has a FROM clause; its default graph is then not the union."""
    return any("FROM" in keywords_of(text) for text in _readings(sparql))


def check_no_service(sparql: str) -> None:
    """Raises QueryRefusedError if the text has a SERVICE clause."""
    if any(_SERVICE.search(text) for text in _readings(sparql)):
        raise QueryRefusedError(f"{_ALONE}; {_JOINED}")


def check_no_load(sparql: str) -> None:
    """Raises QueryRefusedError if the text has a LOAD operation."""
    if any(_LOAD.search(text) for text in _readings(sparql)):
        raise QueryRefusedError(
            "LOAD is refused: an update cannot read other sources; write INSERT DATA"
        )


def check_no_update(sparql: str, *, hint: str = "; write through SemanticMap.update") -> None:
    """Raises QueryRefusedError if the text is SPARQL Update."""
    for text in _readings(sparql):
        first = next((word for word in keywords_of(text) if word not in ("PREFIX", "BASE")), "")
        if first in _UPDATES:
            raise QueryRefusedError(
                f"{first} is an update: a query only reads (SELECT, ASK, CONSTRUCT, DESCRIBE){hint}"
            )


def check_nesting(sparql: str) -> None:
    """Raises QueryRefusedError if brackets nest deeper than MAX_DEPTH.

    At every door: far beyond it the parser ends the process.
    """
    for text in _readings(sparql):
        if sum(map(text.count, "({[")) <= MAX_DEPTH:
            continue  # most queries
        depth = 0
        for token in tokens_of(text):
            depth += (token.text in ("(", "{", "[")) - (token.text in (")", "}", "]"))
            if depth > MAX_DEPTH:
                raise QueryRefusedError(
                    f"brackets may nest {MAX_DEPTH} deep, here they nest deeper"
                )


def _readings(sparql: str) -> Iterable[str]:
    # the standard decodes escapes first; the engine only those in strings, IRIs and names
    return dict.fromkeys((sparql, decode_escapes(sparql)))


def has_allowed_service(sparql: str, allowed: Collection[str]) -> bool:
    """Whether the text has a SERVICE clause with one of the `allowed` endpoints."""
    return bool(allowed) and _allowed_clause(allowed).search(sparql) is not None


def check_network_words(sparql: str, allowed: Collection[str]) -> None:
    """Raises QueryRefusedError for the letters of SERVICE or LOAD anywhere in the text.

    For processes whose network the kernel cannot block. Strings, comments and names with these
    letters are rejected too, since only the engine's parser can tell them apart. Clauses with an
    `allowed` endpoint pass.
    """
    rest = _allowed_clause(allowed).sub("", sparql) if allowed else sparql
    for word in ("service", "load"):
        if word in decode_escapes(rest).lower():
            raise QueryRefusedError(
                f"the letters of {word.upper()} are refused anywhere in a query, since on this "
                "machine the kernel cannot deny queries the network; rewrite strings with them"
            )


def _allowed_clause(allowed: Collection[str]) -> re.Pattern[str]:
    iris = "|".join(re.escape(iri) for iri in allowed)
    return re.compile(rf"(?<!\w)service\s+(?:silent\s+)?<(?:{iris})>", re.IGNORECASE)


def _check_services(sparql: str, allowed: Collection[str]) -> None:
    endpoints = [match["endpoint"] for match in _SERVICE.finditer(sparql)]
    # also as a language tag, which may be a keyword to the engine
    words = sum(token.text.upper() in ("SERVICE", "@SERVICE") for token in tokens_of(sparql))
    if words > len(endpoints) or any(endpoint[1:-1] not in allowed for endpoint in endpoints):
        instead = f"allowed are: {', '.join(sorted(allowed))}" if allowed else _JOINED
        raise QueryRefusedError(f"{_ALONE}; {instead}")


_SIGNS: Final = {"AND": "&&", "OR": "||"}  # of other query languages' words
_BLOCKS: Final = ("OPTIONAL", "UNION", "MINUS", "EXISTS")
_BRACKETS: Final = {"{": "}", "(": ")", "[": "]"}
_FORMS: Final = (
    *("SELECT", "ASK", "CONSTRUCT", "DESCRIBE", "PREFIX", "BASE", "INSERT", "DELETE", "WITH"),
    *("CLEAR", "DROP", "CREATE", "ADD", "COPY", "MOVE", "LOAD"),
)
_CLAUSES: Final = (
    *("WHERE", "FROM", "NAMED", "GRAPH", "OPTIONAL", "UNION", "MINUS", "FILTER", "BIND", "VALUES"),
    *("SERVICE", "SILENT", "DISTINCT", "REDUCED", "ORDER", "GROUP", "HAVING", "BY", "ASC", "DESC"),
    *("LIMIT", "OFFSET", "EXISTS", "NOT", "IN", "AS", "UNDEF", "DATA", "USING", "INTO", "TO"),
    *("DEFAULT", "ALL", "TRUE", "FALSE", "A", "SEPARATOR", "LATERAL", "VERSION"),
)
_FUNCTIONS: Final = (
    *("COUNT", "SUM", "MIN", "MAX", "AVG", "SAMPLE", "GROUP_CONCAT", "STR", "LANG", "LANGMATCHES"),
    *("DATATYPE", "BOUND", "IRI", "URI", "BNODE", "RAND", "ABS", "CEIL", "FLOOR", "ROUND", "IF"),
    *("CONCAT", "STRLEN", "UCASE", "LCASE", "ENCODE_FOR_URI", "CONTAINS", "STRSTARTS", "STRENDS"),
    *("STRBEFORE", "STRAFTER", "YEAR", "MONTH", "DAY", "HOURS", "MINUTES", "SECONDS", "TIMEZONE"),
    *("TZ", "NOW", "UUID", "STRUUID", "MD5", "SHA1", "SHA256", "SHA384", "SHA512", "COALESCE"),
    *("STRLANG", "STRDT", "SAMETERM", "ISIRI", "ISURI", "ISBLANK", "ISLITERAL", "ISNUMERIC"),
    *("REGEX", "SUBSTR", "REPLACE", "TRIPLE", "SUBJECT", "PREDICATE", "OBJECT", "ISTRIPLE"),
    *("LANGDIR", "STRLANGDIR", "HASLANG", "HASLANGDIR", "ADJUST"),
)
_KEYWORDS: Final = (*_FORMS, *_CLAUSES, *_FUNCTIONS)
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
        _undeclared_prefix(tokens)
        or _unclosed_text(sparql, tokens, reason, offset)
        or _first_word(tokens)
        or _word(tokens, terms)
        or _unclosed(sparql, tokens)
        or _bare_expression(tokens)
        or _misfit(tokens)
        or _of_variables(reason)
        or _stop(tokens, offset)
        or _near(tokens, offset)
    )
    return f"does not parse at line {line}, column {at}: {cause}"


def _undeclared_prefix(tokens: list[Token]) -> str:
    declared = [
        after.text.rstrip(":") for token, after in pairwise(tokens) if token.keyword == "PREFIX"
    ]
    known = {*declared, *v.PREFIXES}
    used = (token.text.partition(":")[0] for token in tokens if token.kind == "name")
    prefix = next((name for name in used if name not in known), None)
    if prefix is None:
        return ""
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


def _word(tokens: list[Token], terms: Callable[[], Iterable[str]]) -> str:
    """The cause, where a word is no keyword: SPARQL has no other words."""
    words = (token.text for token in tokens if token.keyword not in ("", *_KEYWORDS))
    word = next((text for text in words if not text[0].isdigit()), None)
    if word is None:
        return ""
    if any(token.kind == "variable" and token.text == f"?{word}" for token in tokens):
        return f"{word!r} is neither a keyword nor a term; did you mean ?{word}?"
    # of two terms with one name, ours
    known = sorted(terms(), key=lambda iri: (iri.startswith(v.HERE), iri))
    names = {v.local_name(iri): v.curie(iri) for iri in known if not v.curie(iri).startswith("<")}
    exact = {name.lower(): text for name, text in names.items()}.get(word.lower())
    exact = _SIGNS.get(word.upper(), exact)
    near = f"; did you mean {exact}?" if exact else did_you_mean(word, _KEYWORDS)
    near = near or did_you_mean(word, names)
    forms = '; terms are prefix:name, <IRI>, ?variable or "text"'
    return f"{word!r} is neither a keyword nor a term{near or forms}"


def _unclosed_text(sparql: str, tokens: list[Token], reason: str, offset: int) -> str:
    """The cause, where a string or an IRI is not closed."""
    for token in reversed([token for token in tokens if token.start < offset]):
        if token.kind == "other" and token.text in "\"'":
            return f"the string that begins at {_place(sparql, token)} is not closed"
        if token.kind == "other" and token.text == "<" and '">"' in reason:
            return f"the IRI that begins at {_place(sparql, token)} has a space, or no >"
    return ""


def _unclosed(sparql: str, tokens: list[Token]) -> str:
    """The cause, where a bracket is not closed, or closes nothing."""
    opened: list[Token] = []
    for token in tokens:
        if token.kind != "mark" or token.text == ";":
            continue
        if token.text in _BRACKETS:
            opened.append(token)
        elif not opened:
            return f"the {token.text} at {_place(sparql, token)} closes nothing"
        elif _BRACKETS[opened[-1].text] == token.text:
            opened.pop()
        else:
            break
    if opened:
        last = opened[-1]
        return (
            f"the {last.text} at {_place(sparql, last)} is not closed; "
            f"a {_BRACKETS[last.text]} is missing"
        )
    return ""


def _bare_expression(tokens: list[Token]) -> str:
    """The cause, where SELECT has an expression without brackets and name."""
    words = [token.keyword for token in tokens]
    for at, word in enumerate(words[:-1]):
        follows = words[at + 2] if words[at + 1] in ("DISTINCT", "REDUCED") else words[at + 1]
        if word == "SELECT" and follows in _FUNCTIONS:
            return (
                f"an expression after SELECT needs brackets and a name: ({follows}(...) AS ?name)"
            )
    return ""


def _misfit(tokens: list[Token]) -> str:
    """The cause, where a keyword or a comma is followed by what never follows it."""
    for token, after in pairwise(tokens):
        word, next_text = token.keyword, after.text
        if word in ("FILTER", "HAVING") and after.kind not in ("mark", "word", "iri", "name"):
            return f"the condition after {token.text} needs brackets: {word}({next_text} ...)"
        if word in ("ORDER", "GROUP") and after.keyword != "BY":
            return f"after {token.text} comes BY: {word} BY {next_text}"
        if word in _BLOCKS and next_text != "{":
            return f"what follows {token.text} needs braces: {word} {{ {next_text} ... }}"
        if word == "SELECT" and _has_comma(token.end, tokens):
            return "variables after SELECT have spaces between them, and no commas"
        if token.text == next_text == "=":
            return "SPARQL compares by =, and not by =="
    return ""


def _has_comma(start: int, tokens: list[Token]) -> bool:
    """Whether a comma stands between the variables that SELECT gives."""
    depth = 0
    for token in tokens:
        depth += (token.text == "(") - (token.text == ")")
        if token.start >= start and depth == 0 and token.text in (",", "{"):
            return token.text == ","
    return False


def _of_variables(reason: str) -> str:
    """The parser's sentence on a variable, such as one neither grouped nor counted."""
    options = reason.removeprefix("expected ").removeprefix("one of ").split(", ")
    found = (option for option in options if " variable " in option)
    return next((option[0].lower() + option[1:] for option in found), "")


def _stop(tokens: list[Token], offset: int) -> str:
    """The cause, where a text ends too early, or a bracket stands where a term should be."""
    after = next((token for token in tokens if token.start >= offset), None)
    if not tokens:
        return "the text is empty"
    if after is None:
        closed = tokens[-1].text in _BRACKETS.values()
        return "" if closed else f"the text ends after {tokens[-1].text!r}"
    if after.text in (*_BRACKETS.values(), ".", ";", ","):
        return f"{after.text!r} comes too early: a term, variable or value is missing before it"
    return ""


def _place(sparql: str, token: Token) -> str:
    before = sparql[: token.start]
    return f"line {before.count(chr(10)) + 1}, column {token.start - before.rfind(chr(10))}"


def _near(tokens: list[Token], offset: int) -> str:
    """The last token that the parser read; what it expected there is rarely what is missing."""
    read = [token for token in tokens if token.start < offset] or tokens
    return f"{read[-1].text!r} does not fit here; before it, a '.', ';' or bracket may be missing"
