"""Words for targets: meaning of a wanted name, and the answer where no detector can see it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from kg.knowledge.ontology.catalogue import Catalogue, name_key
from kg.knowledge.words.meaning import MAX_NAME, Meaning, listed, shown_name, understand
from kg.knowledge.words.usual_places import UsualPlace, UsualPlaces, usual_places
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import ModelError, UndetectableError, UnknownCategoryError
from kg.model.place_names import plain_place
from kg.model.shares import percent
from mapping.looks.word_looks import Alike, alike, compares_texts
from planner.search.goals.place_names import place_category, spoken_places, titled_places

_ALIKE = 3  # things that are said to look like a word
_FEW = 3  # activities or rooms with a thing, below which its place is only named as possible
_BELIEVED = 0.5  # least belief in the category of a place of the map that is named


@dataclass(frozen=True, slots=True)
class Undetectable:
    """A wanted thing that no category includes."""

    meaning: Meaning
    usual: UsualPlaces | None  # None: nothing is known
    here: tuple[tuple[str, str], ...] = ()  # kinds of usual places, and their label in the map
    alike: AlikeHere | None = None  # what looks like it; None: not known

    @property
    def sentences(self) -> list[str]:
        """The answer: that no detector sees it, where it usually is, and where that is here."""
        if self.unknown:
            return [f"'{self.meaning.text}' is no word that is known here", *self.looks]
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
        kinds = [(plain_place(kind), label) for kind, label in self.here]
        plain = {f"a {label}": None for kind, label in kinds if name_key(label) == name_key(kind)}
        lines += [f"This map has {' and '.join(plain)}"] * bool(plain)
        lines += [
            f"The {kind} of this map is {label}"
            for kind, label in kinds
            if name_key(label) != name_key(kind)
        ]
        return [*lines, *self.looks]

    @property
    def looks(self) -> list[str]:
        """Things that look like it, if that is known."""
        return [] if self.alike is None else self.alike.sentences("it")

    @property
    def unknown(self) -> bool:
        """Whether it is no known word, so that its looks alone can tell anything."""
        return self.meaning.how == "unknown"

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
            "looks_like": None if self.alike is None else list(self.alike.things),
            **({} if self.alike is None else self.alike.to_json()),
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
    named one in this map. A text that is no known word has an answer where the map's encoder
    compares it with looks; else None.
    """
    try:
        meaning = any_meaning(semantic_map.catalogue, text)
    except UnknownCategoryError:
        return _by_looks_alone(semantic_map, text)
    if any(not one.undetected for one in meaning.categories):
        return None
    if any(semantic_map.objects(one.iri) for one in meaning.categories):
        return None
    usual = usual_places(meaning.synset)
    here = _places_here(semantic_map, usual.places if usual else ())
    own = meaning.how != "spelling" and meaning.means == meaning.word
    said = text if own else meaning.means
    return Undetectable(meaning, usual, here, alike_here(semantic_map, said, meaning.synset))


def _by_looks_alone(semantic_map: SemanticMap, text: str) -> Undetectable | None:
    """The answer for a text that is no known word, where the encoder of the map knows it."""
    is_place = place_category(semantic_map.catalogue, text) is not None
    if is_place or not any(map(str.isalnum, text)) or len(text) > MAX_NAME:
        return None
    if not compares_texts(semantic_map):
        return None
    shown = shown_name(text)
    meaning = Meaning(shown, shown, "unknown", "none", ())
    return Undetectable(meaning, None, (), alike_here(semantic_map, text))


@dataclass(frozen=True, slots=True)
class AlikeHere:
    """Things of a map that look like a text, in words."""

    found: Alike
    things: tuple[str, ...] = ()  # as in ``bottle 17 in the kitchen``
    problem: str = ""  # why the encoder of the map does not compare

    def sentences(self, what: str) -> list[str]:
        """Which things, and from where a view, look most like `what`."""
        by = f", says the encoder {self.found.encoder}" if self.found.encoder else ""
        lines = [self.problem[:1].upper() + self.problem[1:]] if self.problem else []
        if self.things:
            look = "looks" if len(self.things) == 1 else "look"
            found = _and(self.things)
            lines.append(f"Of the things in this map, {found} {look} most like {what}{by}")
        elif by and not self.found.views:
            lines.append(f"Nothing here looks like {what}{by}")
        elif not by and not self.problem:
            lines.append(f"Nothing with a picture in this map looks like {what}")
        if self.found.views:
            one = self.found.views[0]
            pose = f"({one.x:.1f}, {one.y:.1f}), heading {math.degrees(one.heading):.0f} degrees"
            lines.append(f"The view from {pose}, looks most like {what}{by}")
        return lines

    def to_json(self) -> dict[str, object]:
        """The encoder, and the views that look like the text; {} for the bundled classifier."""
        if not self.found.encoder:
            return {"problem": self.problem} if self.problem else {}
        views = [asdict(one) for one in self.found.views[:_ALIKE]]
        return {"encoder": self.found.encoder, "views_like": views}


def alike_here(semantic_map: SemanticMap, text: str, synset: str = "") -> AlikeHere | None:
    """Things that look most like a text, or a synset of WordNet; None where it cannot be known.

    Raises ModelError where there is no synset, and the map's encoder cannot compare the text.
    """
    problem = ""
    try:
        found = alike(semantic_map, text, synset)
    except ModelError as error:
        if not synset:
            raise
        problem = str(error)
        found = alike(semantic_map, text, synset, bundled=True)
    if found is None:
        return AlikeHere(Alike(()), (), problem) if problem else None
    things = (*semantic_map.objects(), *semantic_map.unnamed_things())
    records = {record.iri: record for record in things}
    places, described = spoken_places(semantic_map), []
    for record in (records[one.iri] for one in found.things[:_ALIKE]):
        title = semantic_map.catalogue.title(record.category, record.iri)
        where = f" in {places[record.place]}" if record.place in places else ""
        described.append(f"{title}{where}")
    return AlikeHere(found, tuple(described), problem)


def _and(parts: tuple[str, ...]) -> str:
    """``a, b and c``."""
    return " and ".join(filter(None, (", ".join(parts[:-1]), parts[-1])))


def _places_here(
    semantic_map: SemanticMap, usual: tuple[UsualPlace, ...]
) -> tuple[tuple[str, str], ...]:
    """For each usual kind of place, the title of the first such place of the map."""
    found = []
    places = titled_places(semantic_map) if usual else ()
    for one in usual:
        category = semantic_map.catalogue.get(one.label, "place")
        names = {name_key(one.label), name_key(plain_place(one.label))}
        for place, title in places:
            believed = category and place.beliefs.get(category.iri, 0.0) >= _BELIEVED
            if believed or name_key(place.label) in names:
                found.append((one.label, title))
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
    """``on a table or on a hook in the corridor or kitchen``."""
    supports = listed(usual.supports)
    if usual.source == "stated":
        rooms = listed([plain_place(place.label) for place in usual.places])
    else:
        unit = "such rooms have one" if usual.source == "homes" else "activities with one"
        first, *others = usual.places
        rooms = listed([_counted(first, unit), *(_counted(place) for place in others)])
    return f"{supports}{' ' * bool(supports)}in the {rooms}"


def _counted(place: UsualPlace, unit: str = "") -> str:
    """``kitchen (60% of 7 such rooms have one)``: the smoothed share."""
    of = f" of {place.total} {unit}" if unit else ""
    return f"{plain_place(place.label)} ({percent(place.probability or 0.0)}{of})"
