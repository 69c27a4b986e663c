"""`/files/NAME`: scripts, styles and pictures of the pages; `vendor/` holds libraries.

`/pictures/17`: the picture of an object's best observation; 204 where none is kept.
"""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.serving.server.app_state import AppState
from kg.serving.server.http.problems import Problem

_TYPES: Final = {"css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}


async def page_file(serving: AppState, request: Request) -> Response:
    """A file of the pages; Problem 404 for an unknown name."""
    name, known = request.path_params["name"], _files()
    if name not in known:
        raise Problem(404, f"no file {name[:100]!r}; there are: {', '.join(known)}")
    body = known[name].read_bytes()
    # revalidated each time: modules of two versions do not fit together
    headers = {"ETag": f'"{sha256(body).hexdigest()[:16]}"', "Cache-Control": "no-cache"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(body, media_type=_TYPES[name.rpartition(".")[2]], headers=headers)


@cache
def _files() -> dict[str, Traversable]:
    folder = files("kg.serving.server").joinpath("files")
    found = {one.name: one for one in folder.iterdir()}
    found |= {f"vendor/{one.name}": one for one in folder.joinpath("vendor").iterdir()}
    return {name: found[name] for name in sorted(found) if name.rpartition(".")[2] in _TYPES}


async def picture(serving: AppState, request: Request) -> Response:
    """The JPEG of `/object/NUMBER`."""
    number, semantic_map = str(request.path_params["number"]), serving.semantic_map
    data = None
    if number.isascii() and number.isdigit():
        iri = f"{semantic_map.base}object/{number}"
        data = await run_in_threadpool(semantic_map.picture, iri)
    if data is None:
        return Response(status_code=204)
    return Response(data, media_type="image/jpeg", headers={"Cache-Control": "no-cache"})
