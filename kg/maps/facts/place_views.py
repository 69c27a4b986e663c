"""Views of a place (viewed share of its floor, last view): a record to facts, and back."""

from __future__ import annotations

from collections.abc import Iterator

from pyoxigraph import Literal

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import PlaceViews
from kg.rdf.literals import Properties, first, number_literal, stamp_of, time_literal


def facts_of_views(viewed: PlaceViews | None, what: str) -> Iterator[tuple[str, Literal]]:
    """Predicates and values; raises InvalidFactError, which names `what`, for invalid shares."""
    if viewed is None:
        return
    if not 0 <= viewed.close_share <= viewed.share <= 1:
        raise InvalidFactError(
            f"{what}: shares viewed must lie between 0 and 1, got {viewed.share:g} and, from close "
            f"by, {viewed.close_share:g}"
        )
    yield v.VIEWED_SHARE, number_literal(viewed.share, f"{what}: share viewed")
    yield v.CLOSELY_VIEWED_SHARE, number_literal(viewed.close_share, f"{what}: share viewed")
    yield v.LAST_VIEWED, time_literal(viewed.last, f"{what}: last viewed")


def views_of(properties: Properties) -> PlaceViews | None:
    """The views that a place's properties state; None without them."""
    if v.VIEWED_SHARE not in properties or v.LAST_VIEWED not in properties:
        return None
    share = float(first(properties, v.VIEWED_SHARE, "0"))
    close = float(first(properties, v.CLOSELY_VIEWED_SHARE, "0"))
    return PlaceViews(share, min(close, share), stamp_of(properties, v.LAST_VIEWED))
