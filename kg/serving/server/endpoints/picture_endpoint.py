"""`/pictures/17`: the picture of an object's best observation; 204 where none is kept."""

from __future__ import annotations

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.serving.server.app_state import AppState


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
