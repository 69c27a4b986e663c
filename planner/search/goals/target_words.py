"""Words for targets: meaning of a wanted name, and the answer where no detector can see it."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from kg.knowledge.ontology.catalogue import Catalogue, name_key
from kg.knowledge.words.meaning import Meaning, listed, shown_name, understand
from kg.knowledge.words.usual_places import UsualPlace, UsualPlaces, usual_places
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UndetectableError, UnknownCategoryError
from kg.model.place_names import plain_place
from mapping.looks.word_looks import things_that_look_like
from planner.search.goals.place_names import in_words, place_category

_ALIKE = 3  # things that are said to look like a word
_FEW = 3  # activities or rooms with a thing, below which its place is only named as possible
_BELIEVED = 0.5  # least belief in the category of a place of the map that is named


@dataclass(frozen=True, slots=True)
class Undetectable:
    """A wanted thing that no category includes."""

    meaning: Meaning
    usual: UsualPlaces | None  # None: nothing is known
    here: tuple[tuple[str, str], ...] = ()  # kinds of usual places, and their label in the map
    alike: tuple[str, ...] | None = None  # things of the map that look like it; None: not known

    @property
    def sentences(self) -> list[str]:
        """The answer: that no detector sees it, where it usually is, and where that is here."""
        known = self.meaning
        name = known.word if known.how == "spelling" else known.text
        english = f" ({known.means})" if known.means != known.word else ""
        lines = [known.note] if known.note else []
        lines.append(f"No detector here can see things called '{name}'{english}")
        if known.related:
            lines.append(f"They are parts of a {listed(known.related)}; search for that")
        if self.usual is not None:
            lines.append(f"They are {_how_often(self.usual)} {_where(self.usual)}")
        elif not known.related:
            lines.append("Nothing is known about where they usually are")
        lines += [
            f"The {plain_place(kind)} of this map is {label}"
            if name_key(label) != name_key(plain_place(kind))
            else f"This map has a {label}"
            for kind, label in self.here
        ]
        if self.alike:
            first = " and ".join(filter(None, (", ".join(self.alike[:-1]), *self.alike[-1:])))
            look = "looks" if len(self.alike) == 1 else "look"
            lines.append(f"Of the things in this map, {first} {look} most like it")
        elif self.alike is not None:
            lines.append("Nothing with a picture in this map looks like it")
        return lines

    @property
    def answer(self) -> str:
        """The sentences as one text, without the last full stop."""
        return ". ".join(self.sentences)

    def to_json(self) -> dict[str, object]:
        """Plain values for JSON."""
        usual = self.usual
        return {
            "target": self.meaning.text,
            "word": self.meaning.word,
            "synset": self.meaning.synset or None,
            "answer": self.answer + ".",
            "source": usual and usual.source,
            "places": [asdict(place) for place in usual.places] if usual else [],
            "supports": list(usual.supports) if usual else [],
            "in_this_map": [{"place": label, "kind": kind} for kind, label in self.here],
            "looks_like": None if self.alike is None else list(self.alike),
        }


def meaning_of(catalogue: Catalogue, text: str) -> Meaning:
    """The meaning of a target's name; always with categories.

    Raises:
        UndetectableError: no category includes such things; the message says where they usually
            are.
        UnknownCategoryError: it is no known word, or a kind of place.
    """
    meaning = any_meaning(catalogue, text)
    if not meaning.categories:
        raise UndetectableError(Undetectable(meaning, usual_places(meaning.synset)).answer)
    return meaning


def any_meaning(catalogue: Catalogue, text: str) -> Meaning:
    """As `meaning_of`, also for things that no category includes.

    Raises UnknownCategoryError.
    """
    if place_category(catalogue, text) is not None:
        shown = shown_name(text)
        raise UnknownCategoryError(
            f"'{shown}' is a kind of place, not something to search for; "
            f"`hereabouts ask MAP 'where is the {shown}'` tells where it is"
        )
    return understand(catalogue, text)


def undetectable(semantic_map: SemanticMap, text: str) -> Undetectable | None:
    """The answer for a thing that no detector can see, with places of the map; else None.

    No category includes such things, or only one by which people name things, and nobody has
    named one in this map. None for a text that is no known word, too.
    """
    try:
        meaning = any_meaning(semantic_map.catalogue, text)
    except UnknownCategoryError:
        return None
    if any(not one.undetected for one in meaning.categories):
        return None
    if any(semantic_map.objects(one.iri) for one in meaning.categories):
        return None
    usual = usual_places(meaning.synset)
    here = _places_here(semantic_map, usual.places if usual else ())
    return Undetectable(meaning, usual, here, _alike(semantic_map, meaning.synset))


def _alike(semantic_map: SemanticMap, synset: str) -> tuple[str, ...] | None:
    """Things that look most like a word, as in ``object/17 (bottle, in the kitchen)``."""
    found = things_that_look_like(semantic_map, synset)
    if found is None:
        return None
    things = (*semantic_map.objects(), *semantic_map.unnamed_things())
    records = {record.iri: record for record in things}
    places = {place.iri: place.label for place in semantic_map.places()}
    described = []
    for record in (records[one.iri] for one in found[:_ALIKE]):
        known = semantic_map.catalogue.by_iri(record.category)
        parts = [] if known is None else [known.label]
        if record.place in places:
            parts.append(f"in {in_words(semantic_map.catalogue, places[record.place])}")
        described.append(f"{record.iri.removeprefix(semantic_map.base)} ({', '.join(parts)})")
    return tuple(described)


def _places_here(
    semantic_map: SemanticMap, usual: tuple[UsualPlace, ...]
) -> tuple[tuple[str, str], ...]:
    """For each usual kind of place, the label of the first such place of the map."""
    found = []
    places = semantic_map.places() if usual else ()
    for one in usual:
        category = semantic_map.catalogue.get(one.label, "place")
        names = {name_key(one.label), name_key(plain_place(one.label))}
        for place in places:
            believed = category and place.beliefs.get(category.iri, 0.0) >= _BELIEVED
            if believed or name_key(place.label) in names:
                found.append((one.label, place.label))
                break
    return tuple(found)


def _how_often(usual: UsualPlaces) -> str:
    """``usually`` for half of the cases or more, ``perhaps`` where few were counted."""
    first = usual.places[0]
    if first.probability is None:
        return "usually"
    if first.count < _FEW:
        return "perhaps"
    return "usually" if first.probability >= _BELIEVED else "most often"


def _where(usual: UsualPlaces) -> str:
    """``on a table or on a hook in the corridor or kitchen (common knowledge, no counts)``."""
    supports = listed(usual.supports)
    if usual.source == "stated":
        rooms = listed([plain_place(place.label) for place in usual.places])
        rooms += " (common knowledge, no counts)"
    else:
        unit = "such rooms have one" if usual.source == "homes" else "activities with one"
        first, *others = usual.places
        rooms = listed([_counted(first, unit), *(_counted(place) for place in others)])
    return f"{supports}{' ' * bool(supports)}in the {rooms}"


def _counted(place: UsualPlace, unit: str = "") -> str:
    """``kitchen (60% of 7 such rooms have one)``: the smoothed share."""
    of = f" of {place.total} {unit}" if unit else ""
    return f"{plain_place(place.label)} ({place.probability:.0%}{of})"
