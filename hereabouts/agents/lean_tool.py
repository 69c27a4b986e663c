"""A tool of the package `mcp` with a short schema, short answers, and errors in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Final, Self, cast

from mcp.server.mcpserver import Image
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.tools import Tool
from mcp_types import CallToolResult, ContentBlock, TextContent, ToolAnnotations
from pydantic import Field, ValidationError

from hereabouts.agents.answers import Answer
from hereabouts.agents.argument_errors import argument_error
from hereabouts.agents.pages import document_of, text_of
from hereabouts.agents.untrusted_text import in_one_line
from kg.model.errors import HereaboutsError

Method = Callable[..., Any]

#: keywords of JSON Schema that tell a model nothing: the arguments are checked in any case
_LEFT_OUT: Final = frozenset(
    ("title", "minLength", "maxLength", "minimum", "maximum", "exclusiveMinimum", "minItems")
)


class LeanTool(Tool):
    """A method as a tool; its answers are those of `hereabouts.agents.pages`."""

    base: str = Field("", exclude=True)  # of the map

    @classmethod
    def of(cls, method: Method, about: str, hints: ToolAnnotations, base: str) -> Self:
        """The tool of `method`, which returns an Answer, or one with an Image, of a map `base`."""

        def answering(**arguments: Any) -> CallToolResult:
            return _result(method(**arguments), base)

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


def _result(found: Any, base: str) -> CallToolResult:
    answer, *images = found if isinstance(found, tuple) else (found,)
    assert isinstance(answer, Answer)
    document = document_of(answer, base)
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
