"""Meaning of a name that a person or an agent gives to a thing.

One resolver for all interfaces: names of the ontology, then exact words, then folded forms (plural,
case, hyphens, articles), then the head noun of a compound, and only then typing errors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key, readings
from kg.knowledge.words.tables import Relation, Sense, WordTable, corrected, suggestions, word_table
from kg.model.errors import UnknownCategoryError

MAX_NAME: Final = 100  # characters of a name
_SHOWN: Final = 40  # characters of a refused name in a message
_KINDS: Final = ("object", "supercategory")
_ARTICLES: Final = frozenset(
    (
        *("a", "an", "the", "my", "your", "his", "her", "our", "their", "some", "any", "this"),
        *("der", "die", "das", "ein", "eine", "einen", "mein", "meine", "meinen"),
    )
)
#: Heads that often name something else in a compound: cable tie, baby monitor, trash bag.
_MISLEADING: Final = frozenset(
    (
        *("tie", "glass", "screen", "monitor", "bag", "plant", "horse", "bear", "car", "boat"),
        *("truck", "train", "bus", "plane", "bird", "bat", "person", "table", "tv", "bed", "cup"),
        *("range", "dog", "cat", "fork", "sheep", "cow", "kite", "seat", "display"),
    )
)
#: First words of compounds that are no kind of their head.
_PRETENDED: Final = frozenset(("toy", "fake", "plastic", "miniature", "model", "paper", "lego"))
#: Words before "of" that name an amount of what follows.
_AMOUNTS: Final = frozenset(("bunch", "pair", "piece", "set", "pile", "stack", "bit", "slice"))
_SEPARATORS: Final = frozenset(";,|<>()=:.")  # not in compounds
#: Words after which a name goes on about another thing: a book about dogs is no dog.
_PHRASES: Final = frozenset(
    (
        *("than", "as", "and", "or", "not", "with", "without", "about", "for", "from", "in", "on"),
        *("under", "by", "near", "at", "beside", "behind", "mit", "ohne", "aus", "und", "oder"),
    )
)
_PLURALS: Final = ("", "n", "en", "e", "er", "s")  # endings of German plurals
_MIN_HEAD: Final = 4  # letters of the last part of a German compound

#: "unknown" is a text that is no known word, and is told by looks alone
How = Literal["label", "word", "folded", "head", "spelling", "unknown"]


@dataclass(frozen=True, slots=True)
class Meaning:
    """Meaning of a name.

    `categories` are those of the ontology in which things with that name are; empty where no
    category includes them.
    """

    text: str  # as given, printable
    word: str  # the known word that decided
    how: How
    relation: Relation
    categories: tuple[Category, ...]
    related: tuple[str, ...] = ()  # labels of categories that it is a part of

    @property
    def iris(self) -> list[str]:
        """IRIs of `categories`."""
        return [one.iri for one in self.categories]

    @property
    def means(self) -> str:
        """The English word for a name in another language; else `word`."""
        return word_table().names.get(name_key(self.word), self.word)

    @property
    def synset(self) -> str:
        """WordNet's name of the sense, as cup.n.01; "" where the word has none."""
        return self._sense().synset

    @property
    def gloss(self) -> str:
        """The sense in a few words, or ""."""
        return self._sense().gloss

    def _sense(self) -> Sense:
        senses = word_table().senses
        keys = [name_key(self.word), name_key(self.means)]
        if self.how == "label":
            keys.insert(0, name_key(self.text))
        found = (senses[key] for key in keys if key in senses)
        return next(found, Sense("", "none", (), (), ""))

    @property
    def note(self) -> str:
        """One sentence says how the name was understood; "" where it is a category's own name."""
        wider = [one for one in self.categories if not one.undetected]
        labels = listed([one.label for one in wider])
        typed = f"'{self.text}' is read as {self.word}" if self.how == "spelling" else ""
        texts = (self.word,) if typed else (self.text, " ".join(_words_of(self.text)))
        own = {reading for text in texts for reading in readings(name_key(text))}
        if not labels or name_key(labels) in own:
            return typed
        subject = f"{typed}, and {self.word}" if typed else f"'{self.text}'"
        if self.how == "head" and self.relation == "narrower":
            return f"{subject} is read as a kind of {labels}"
        return {
            "narrower": f"{subject} is a kind of {labels}",
            "may": f"{subject} may be detected as {labels}",
        }.get(self.relation, f"{subject} means {labels}")


def understand(catalogue: Catalogue, text: str) -> Meaning:
    """The meaning of a name of a thing, such as ``coffee mug``, ``Tassen`` or ``bannana``.

    Names of places are not understood here.

    Raises:
        UnknownCategoryError: the name is empty, too long, or no known word; the message names
            similar words.
    """
    shown = shown_name(text)
    if not any(c.isalnum() for c in text):
        raise UnknownCategoryError(
            f"{shown!r} is no name of a thing; a name such as cup or coffee mug would work"
        )
    if len(text) > MAX_NAME and catalogue.get(text) is None:
        raise UnknownCategoryError(
            f"a name of a thing has at most {MAX_NAME} characters, got {len(text):,}: {shown!r}"
        )
    key = name_key(text)
    known = catalogue.by_iri(text) or _category(catalogue, key)
    if known is not None and known.kind in _KINDS and not known.undetected:
        return Meaning(shown, known.label, "label", "same", (known,))  # needs no table
    reader = _Reader(catalogue, word_table())
    words = _words_of(text)
    found = reader.read(words)
    if found is None or (found.how == "head" and len(words) > 1):
        found = reader.correct(words) or found
    if found is None:
        raise UnknownCategoryError(reader.unknown(shown, text))
    return replace(found, text=shown)


def listed(names: Sequence[str]) -> str:
    """``fork, knife or spoon``."""
    return " or ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def _category(catalogue: Catalogue, key: str) -> Category | None:
    found = (catalogue.named(key, kind) for kind in _KINDS)
    return next(filter(None, found), None)


def shown_name(text: str) -> str:
    """A name as messages show it: printable characters, single spaces, at most 40 characters."""
    plain = " ".join("".join(c if c.isprintable() else " " for c in text[:500]).split())
    return plain if len(plain) <= _SHOWN else plain[: _SHOWN - 3] + "..."


def _words_of(text: str) -> list[str]:
    """The words of a name without articles and marks that do not print."""
    plain = "".join(c if c.isprintable() else " " * c.isspace() for c in text)
    words = plain.replace("_", " ").split()
    while len(words) > 1 and words[0].casefold() in _ARTICLES:
        words = words[1:]
    return words


@dataclass(frozen=True, slots=True)
class _Reader:
    catalogue: Catalogue
    table: WordTable

    def read(self, words: list[str]) -> Meaning | None:
        """The meaning of a name without typing errors, or None."""
        found = self._name(" ".join(words))
        if found is None and "of" in words[1:-1]:
            split = words.index("of", 1)
            first, last = words[:split], words[split + 1 :]
            return self.read(last if " ".join(first).casefold() in _AMOUNTS else first)
        plain = (_PHRASES | _ARTICLES).isdisjoint(word.casefold() for word in words[1:])
        if found is None and plain and _SEPARATORS.isdisjoint(" ".join(words)):
            found = self._head(words)
        return found

    def correct(self, words: list[str]) -> Meaning | None:
        """The meaning of a name with typing errors, or None.

        A compound is corrected as a whole only where its head, or another word, is not known:
        else it is a kind of its head that no name is for.
        """
        names = self._names()

        def sense(key: str) -> str:
            found = self._name(names[key])
            return "" if found is None else listed(found.iris) or found.synset

        parts = {name_key(part) for name in names.values() for part in name.split()}
        known_head = len(words) > 1 and self._name(words[-1]) is not None
        if not known_head or any(name_key(word) not in parts for word in words):
            key = corrected(name_key(" ".join(words)), names, sense)
            if key is not None and (found := self._name(names[key])) is not None:
                return replace(found, how="spelling", word=names[key])
        head = None if known_head else corrected(name_key(words[-1]), names, sense)
        if len(words) > 1 and head is not None:
            found = self.read([*words[:-1], names[head]])
            return found and replace(found, how="spelling")
        return None

    def unknown(self, shown: str, text: str) -> str:
        """The message about a name that nobody knows."""
        names = self._names()
        close = [names[key] for key in suggestions(name_key(text), names)]
        hint = f"; did you mean {' or '.join(dict.fromkeys(close))}?" if close else ";"
        count = sum(c.kind == "object" for c in self.catalogue.categories)
        return (
            f"no category '{shown}'{hint} it is none of the {count} kinds of objects known here, "
            f"nor of {len(self.table.senses):,} other words"
        )

    def _names(self) -> dict[str, str]:
        """All known names by key: those of the ontology, and words."""
        categories = [c for c in self.catalogue.categories if c.kind in _KINDS]
        own = {name_key(n): n for c in categories for n in (c.label, *c.synonyms)}
        return {**self.table.words, **own}

    def _name(self, name: str) -> Meaning | None:
        """The meaning of a name by exact and then by folded form."""
        for how, keys in (("word", [name_key(name)]), ("folded", [*readings(name_key(name))][1:])):
            for key in keys:
                category = _category(self.catalogue, key)
                if category is not None and category.undetected:
                    return self._undetected(category, key)
                if category is not None:
                    return Meaning(name, category.label, "label", "same", (category,))
                if (sense := self._sense(key)) is not None:
                    word = self.table.words.get(key, name)
                    return self._meaning(sense, word, "folded" if how == "folded" else "word")
        return None

    def _sense(self, key: str) -> Sense | None:
        found = self.table.senses.get(key)
        if found is None and (means := self._named(key)) is not None:
            category = _category(self.catalogue, name_key(means))
            if category is not None:
                return Sense("", "same", (category.label,), (category.label,), "")
            found = self.table.senses.get(name_key(means))
        return found

    def _undetected(self, category: Category, key: str) -> Meaning:
        """A class that people alone name things by, and the categories that include it."""
        sense = self._sense(key)
        found = Meaning(category.label, category.label, "label", "same", (category,))
        if sense is None or sense.relation in ("none", "part"):
            return found
        wider = self._meaning(sense, category.label, "label")
        own = tuple(dict.fromkeys((category, *wider.categories)))
        return replace(found, relation=wider.relation, categories=own)

    def _named(self, key: str) -> str | None:
        """The word that a name in another language, or its plural, means."""
        stems = (key.removesuffix(ending) for ending in _PLURALS)
        return next((self.table.names[one] for one in stems if one in self.table.names), None)

    def _meaning(self, sense: Sense, word: str, how: How) -> Meaning:
        found = [_category(self.catalogue, name_key(label)) for label in sense.categories]
        inside = tuple(filter(None, found)) if sense.relation != "part" else ()
        related = sense.categories if sense.relation == "part" else ()
        relation: Relation = sense.relation if inside or related else "none"
        return Meaning(word, word, how, relation, inside, related)

    def _head(self, words: list[str]) -> Meaning | None:
        """The meaning of a compound as a kind of its head; None where that often misleads."""
        for tail in _tails(words, self._named):
            found = self._name(tail)
            if found is None:
                continue
            pretended = words[0].casefold() in _PRETENDED or name_key(tail) in _MISLEADING
            if found.categories and pretended:
                return None
            if found.relation == "broader":  # a particular kind need not be one of these
                found = replace(found, relation="none", categories=())
            relation: Relation = "narrower" if found.relation == "same" else found.relation
            return replace(found, how="head", relation=relation)
        return None


def _tails(words: list[str], named: Callable[[str], str | None]) -> Iterator[str]:
    """Shorter and shorter ends of a name; of a single word those that are German names."""
    for first in range(1, len(words)):
        yield " ".join(words[first:])
    key = name_key(words[-1]) if words else ""
    for first in range(2, len(key) - _MIN_HEAD + 1):
        if named(key[first:]) is not None:
            yield key[first:]
