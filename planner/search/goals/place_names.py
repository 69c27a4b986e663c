"""Names of places and objects of a map: labels, numbers, IRIs, categories of one place."""

from __future__ import annotations

from kg.knowledge.ontology.catalogue import Catalogue, Category
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UnknownCategoryError

#: The catalogue calls a bathroom what Places205 calls it.
_PLAIN = {"shower": "bathroom", "lobby": "entrance hall"}


def plain_place(label: str) -> str:
    """The everyday name of a category of places, by its label."""
    return _PLAIN.get(label, label)


def place_category(catalogue: Catalogue, text: str) -> Category | None:
    """The category of places that a name means; None for names of things, which come first."""
    return None if catalogue.get(text, "object") else catalogue.get(text, "place")


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
    """IRI of the object that a label (``cup 2``), ``object/2`` or an IRI names, else "".

    Raises QueryParameterError for a category with a number that no object has (``cup 99``); the
    message lists those that there are.
    """
    try:
        iri = semantic_map.resolve("iri", text)
    except QueryParameterError:
        category, _, number = text.strip().rpartition(" ")
        catalogue = semantic_map.catalogue
        if number.isdigit() and catalogue.get(category, "object") and not catalogue.get(text):
            raise
        return ""
    return iri if iri.startswith(f"{semantic_map.base}object/") else ""
