"""A tool of the package `mcp` with a short schema, short answers, and errors in one line.

An error names the argument, the limit and a short form of the value. An answer is one line of JSON
without empty fields, of bounded length, page by page.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final, Self, cast

from mcp.server.mcpserver import Image
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.tools import Tool
from mcp_types import CallToolResult, ContentBlock, TextContent, ToolAnnotations
from pydantic import Field, ValidationError
from pydantic_core import ErrorDetails

from hereabouts.agents.answers import Page, ToolAnswer
from hereabouts.agents.map_context import MapContext
from hereabouts.agents.plain_values import escaped, in_one_line
from kg.model.errors import HereaboutsError, QueryParameterError

_SHOWN: Final = 40  # characters of a value

#: kind of error of pydantic -> the limit in words
_WORDS: Final = {
    "string_too_long": "should have at most {max_length:,} characters",
    "string_too_short": "should have at least {min_length:,} character",
    "too_long": "should have at most {max_length:,} entries",
    "too_short": "should have {min_length:,} or more entries",
    "less_than_equal": "should be less than or equal to {le:,.12g}",
    "less_than": "should be less than {lt:,.12g}",
    "greater_than_equal": "should be greater than or equal to {ge:,.12g}",
    "greater_than": "should be greater than {gt:,.12g}",
    "finite_number": "should be a finite number",
    "string_type": "should be a text",
    "list_type": "should be a list",
    "dict_type": "should be an object",
    "bool_type": "should be true or false",
    "bool_parsing": "should be true or false",
    "int_type": "should be a whole number",
    "int_parsing": "should be a whole number",
    "int_parsing_size": "should be a whole number",
    "int_from_float": "should be a whole number",
    "float_type": "should be a number",
    "float_parsing": "should be a number",
    "literal_error": "should be {expected}",
    "missing": "is missing",
}


def argument_error(error: ValidationError) -> str:
    """``what should have at most 100 characters, got 5,000``: one wrong argument, in one line."""
    details = error.errors(include_url=False)
    first = details[0]
    name = _name(first["loc"])
    same = [one for one in details if one["loc"][:1] == first["loc"][:1]]  # an error for each type
    words = list(dict.fromkeys(map(_limit, same)))
    limit = " or ".join([words[0], *(word.removeprefix("should be ") for word in words[1:])])
    return f"{name} {limit}" if first["type"] == "missing" else f"{name} {limit}, got {_got(first)}"


def _name(path: tuple[int | str, ...]) -> str:
    """``what``, or ``entry 2 of what``; names of types, which follow, are left out."""
    entry = path[1] if len(path) > 1 else None
    argument = str(path[0]) if path else "the argument"
    return f"entry {entry + 1} of {argument}" if isinstance(entry, int) else argument


def _limit(one: ErrorDetails) -> str:
    kind = one["type"]
    if kind == "too_long" and isinstance(one["input"], str):
        kind = "string_too_long"
    return _WORDS.get(kind, "should have another form").format(**one.get("ctx", {}))


def _got(one: ErrorDetails) -> str:
    """A short value as it is; of a long one its length."""
    value, kind = one["input"], one["type"]
    if kind.endswith("too_long"):
        return f"{len(value):,}"
    shown = repr(value)
    return shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]} ..."


#: maximum characters of an answer: 1,500 tokens of four characters with what the protocol adds. An
#: answer is sent twice, as text, in which quotes are escaped, and as structured content.
MAX_CHARACTERS: Final = 5_800
PLACES: Final = ("untrusted_place", "untrusted_into")  # fields with labels of places
SHORT: Final = 80  # characters of each text where there is no room for whole ones


def document_of(
    answer: ToolAnswer, base: str, titles: Callable[[], Mapping[str, str]] = dict
) -> dict[str, Any]:
    """An answer as plain values: without empty fields, and with IRIs relative to `base`.

    Places have their `titles`, by their labels, as people read them.

    A list that is too long is cut; `more` is then the `skip` of the next page. Raises
    QueryParameterError if a single entry is too long, even with texts of `SHORT` characters.
    """
    document: dict[str, Any] = _lean_fields(answer.model_dump(mode="json"), base)
    _entitle(document, cache(titles))
    if _length(document) > MAX_CHARACTERS and not isinstance(answer, Page):
        shorter: dict[str, Any] = _shortened(document)
        return shorter
    if not isinstance(answer, Page):
        return document
    entries = document.setdefault(answer.listed, [])
    document.pop("skip", None)
    while True:
        if (more := answer.skip + len(entries)) < answer.total and entries:
            document["more"] = more
        if _length(document) <= MAX_CHARACTERS:
            return document
        if len(entries) > 1:
            entries.pop()
            continue
        document = _shortened(document)
        if _length(document) <= MAX_CHARACTERS:
            return document
        raise QueryParameterError(
            "an entry of this answer is too long; ask for less of it, such as fewer columns"
        )


def _entitle(value: Any, titles: Callable[[], Mapping[str, str]]) -> None:
    """Replace the labels of places by their titles; these are read for the first of them."""
    if isinstance(value, list):
        for item in value:
            _entitle(item, titles)
    elif isinstance(value, dict):
        for key, item in value.items():
            if key in PLACES and isinstance(item, str):
                value[key] = titles().get(item, item)
            else:
                _entitle(item, titles)


def _shortened(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _shortened(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_shortened(item) for item in value]
    return escaped(value, SHORT) if isinstance(value, str) else value


def _length(document: dict[str, Any]) -> int:
    text = text_of(document)
    return len(text) + len(json.dumps(text, ensure_ascii=False))


def text_of(document: dict[str, Any]) -> str:
    """The JSON of an answer in one line."""
    return json.dumps(document, ensure_ascii=False, separators=(",", ":"))


def _lean_fields(value: Any, base: str, *, marked: bool = False) -> Any:
    """`value` without None and "" in its objects; texts that are not `marked` lose `base`."""
    if isinstance(value, dict):
        return {
            key: _lean_fields(item, base, marked=key.startswith("untrusted_") or key == "base")
            for key, item in value.items()
            if item is not None and item != ""
        }
    if isinstance(value, list):
        return [_lean_fields(item, base, marked=marked) for item in value]
    if isinstance(value, str) and not marked:
        return value.removeprefix(base) or value
    return value


Method = Callable[..., Any]

#: keywords of JSON Schema that tell a model nothing: the arguments are checked in any case
_LEFT_OUT: Final = frozenset(
    ("title", "minLength", "maxLength", "minimum", "maximum", "exclusiveMinimum", "minItems")
)


class LeanTool(Tool):
    """A method as a tool; its answers are those of `hereabouts.agents.lean_tool`."""

    base: str = Field("", exclude=True)  # of the map

    @classmethod
    def of(cls, method: Method, about: str, hints: ToolAnnotations, context: MapContext) -> Self:
        """The tool of `method`, which returns a ToolAnswer, or one with an Image."""
        base = context.semantic_map.base

        def answering(**arguments: Any) -> CallToolResult:
            return _result(method(**arguments), context)

        tool = cls.from_function(
            method, description=about, annotations=hints, structured_output=False
        )
        lean = {"fn": answering, "parameters": _lean(tool.parameters), "base": base}
        return cast("Self", tool.model_copy(update=lean))

    async def run(
        self, arguments: dict[str, Any], context: Any, convert_result: bool = False
    ) -> Any:
        """The result of a call; an error is one, too: a line that says what would work."""
        unknown = sorted(arguments.keys() - self.parameters.get("properties", {}).keys())
        if unknown:
            known = ", ".join(self.parameters.get("properties", {})) or "none"
            return _failure("ArgumentError", f"no argument {unknown[0]!r}; there are: {known}")
        try:
            return await super().run(arguments, context, convert_result)
        except ToolError as error:
            cause = error.__cause__
            if isinstance(cause, ValidationError):
                return _failure("ArgumentError", argument_error(cause))
            if isinstance(cause, HereaboutsError):
                return _failure(type(cause).__name__, str(cause).replace(self.base, ""))
            return _failure("InternalError", f"{self.name} failed; another call may work")


def _result(found: Any, context: MapContext) -> CallToolResult:
    answer, *images = found if isinstance(found, tuple) else (found,)
    assert isinstance(answer, ToolAnswer)
    document = document_of(answer, context.semantic_map.base, context.place_titles)
    content: list[ContentBlock] = [TextContent(type="text", text=text_of(document))]
    content += [image.to_image_content() for image in images if isinstance(image, Image)]
    return CallToolResult(content=content, structured_content=document)


def _failure(kind: str, message: str) -> CallToolResult:
    """An error in one line, escaped, since it may contain text of the map."""
    report = {"error": kind, "untrusted_message": in_one_line(message)}
    text = json.dumps(report, ensure_ascii=False)
    return CallToolResult(content=[TextContent(type="text", text=text)], is_error=True)


def _lean(schema: Any) -> Any:
    """A schema without keywords that only restrict, and without null as an alternative."""
    if isinstance(schema, list):
        return [_lean(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    options = [one for one in schema.get("anyOf", ()) if one != {"type": "null"}]
    if "anyOf" in schema and len(options) == 1:
        schema = {**{k: v for k, v in schema.items() if k != "anyOf"}, **options[0]}
    return {
        key: {name: _lean(part) for name, part in value.items()}
        if key in ("properties", "$defs")
        else _lean(value)
        for key, value in schema.items()
        if key not in _LEFT_OUT and not (key == "default" and value is None)
    }
