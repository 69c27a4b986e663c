"""Names of places and objects of a map: labels, numbers, IRIs, categories of one place."""

from __future__ import annotations

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UnknownCategoryError


def place_named(semantic_map: SemanticMap, text: str) -> str:
    """IRI of a place by its label, number or IRI, or by a category that one place alone has.

    Raises QueryParameterError, which lists the places, for none or several.
    """
    try:
        return semantic_map.resolve("place", text)
    except QueryParameterError as error:
        try:
            believed = semantic_map.places(text)
        except UnknownCategoryError:
            raise error from None
        if len(believed) > 1:
            iris = ", ".join(place.iri for place in believed)
            raise QueryParameterError(
                f"several places have the category {text!r}; give one of {iris}"
            ) from None
        if not believed:
            raise
        return believed[0].iri


def object_named(semantic_map: SemanticMap, text: str) -> str:
    """IRI of the object that a label (``cup 2``), ``object/2`` or an IRI names, else ""."""
    try:
        iri = semantic_map.resolve("iri", text)
    except QueryParameterError:
        return ""
    return iri if iri.startswith(f"{semantic_map.base}object/") else ""
