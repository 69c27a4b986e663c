"""`/pictures/17`: the picture of an object's best observation; 204 where none is kept."""

from __future__ import annotations

from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.maps.object_pictures import ObjectPictures
from kg.maps.semantic_map import SemanticMap
from kg.serving.server.app_state import AppState


async def picture(serving: AppState, request: Request) -> Response:
    """The JPEG of `/object/NUMBER`."""
    path = serving.semantic_map.store.path
    number = str(request.path_params["number"])
    data = None
    if path is not None and number.isascii() and number.isdigit():
        data = await run_in_threadpool(_read, serving.semantic_map, path, number)
    if data is None:
        return Response(status_code=204)
    return Response(data, media_type="image/jpeg", headers={"Cache-Control": "no-cache"})


def _read(semantic_map: SemanticMap, path: Path, number: str) -> bytes | None:
    found = semantic_map.perceived.objects([f"{semantic_map.base}object/{number}"])
    file = ObjectPictures(path).path_of(found[0]) if found else None
    try:
        return None if file is None else file.read_bytes()
    except OSError:
        return None  # removed meanwhile
