"""Things known by their looks: named ones in later recordings, listed ones, and moved ones.

A map's folder keeps them in `known_things.npz`, so that they outlive the objects they were learned
from. A believed object without an asserted category gets the name of the known thing that it is
most like, as an assertion of `AUTHOR`; an object that somebody says is another thing keeps that.
One object has a name, as long as it is believed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from kg.knowledge.ontology.catalogue import NAMED, name_key
from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.maps.semantic_map import SemanticMap
from kg.maps.thing_names import category_of_name, checked_name, marked_categories
from kg.model.errors import HereaboutsError, ModelError
from kg.model.records import Evidence, ObjectRecord
from kg.model.regular_files import read_bytes
from mapping.looks.look_store import (
    Floats,
    LookStore,
    described,
    feature_statistics,
    features_of,
    likeness,
    most_alike,
)
from mapping.looks.user_encoder import encoder_of, fits, least_fit
from mapping.looks.word_looks import looks_of, network
from mapping.objects.detections.detection_report import BELIEVED
from mapping.objects.tracks import Track
from perception.inference.array_file import DAMAGE, read_arrays, write_arrays

FILE: Final = "known_things.npz"  # in the folder of a map
AUTHOR: Final = "looks"  # of the assertions; people are asked to confirm or retract them
MAX_THINGS: Final = 1000
#: likeness from which a thing may be the known one (lab/research/measurements.md)
MIN_LIKENESS: Final = 0.4
#: likeness, and how much greater it is than to any thing seen before, from which a thing is it
MIN_DISTINCT: Final = 0.6
MAX_SIZE_RATIO: Final = 2.0  # of the longest sides of two views of one thing
_MAX_FILE: Final = 1 << 26  # bytes


@dataclass(frozen=True, slots=True)
class KnownThing:
    """A thing with a name, and n views of it."""

    name: str
    features: Floats  # (n, F)
    source: str = ""  # IRI of the object that was named; "" for a thing taught by pictures
    size: float = math.nan  # [m] longest side; nan where unknown
    marker: str = ""  # as in 4x4_50/17; "" without one


@dataclass(frozen=True, slots=True)
class KnownThings:
    """The known things of a map; `proposed` has "IRI name" of the assertions made so far."""

    things: tuple[KnownThing, ...] = ()
    proposed: tuple[str, ...] = field(default=())

    def with_thing(self, thing: KnownThing) -> KnownThings:
        """These, with `thing` in place of one of the same name and source.

        Raises ModelError where they are too many.
        """
        same = (thing.name, thing.source)
        kept = [one for one in self.things if (one.name, one.source) != same]
        if len(kept) >= MAX_THINGS:
            raise ModelError(f"a map knows up to {MAX_THINGS} things by their looks")
        return KnownThings((*kept, thing), self.proposed)

    @classmethod
    def load(cls, folder: Path) -> KnownThings:
        """Those in the folder of a map; raises ModelError for a damaged file."""
        path = folder / FILE
        if not path.is_file():
            return cls()
        try:
            data = read_arrays(path, _MAX_FILE)
            if str(data["network"]) != network().name:
                return cls()
            features, owner = data["features"].astype(np.float32), data["owner"].astype(int)
            shape = (len(owner), len(feature_statistics()[0]))
            if features.shape != shape or not np.isfinite(features).all():
                raise ValueError(f"features of shape {features.shape}")
            texts = (data[n].tolist() for n in ("name", "source", "size", "marker"))
            things = tuple(
                KnownThing(str(name), features[owner == i], str(source), float(size), str(marker))
                for i, (name, source, size, marker) in enumerate(zip(*texts, strict=True))
            )
            return cls(things, tuple(map(str, data["proposed"].tolist())))
        except DAMAGE as error:
            raise ModelError(
                f"{path} is damaged ({error}); without it things can be named and taught again"
            ) from error

    def save(self, folder: Path) -> None:
        """Write them into the folder of a map; raises ModelError."""
        things, counts = self.things, [len(one.features) for one in self.things]
        empty = np.zeros((0, len(feature_statistics()[0])), np.float32)
        arrays = {
            "network": np.array(network().name),
            "features": np.concatenate([empty, *(o.features for o in things)]).astype(np.float16),
            "owner": np.repeat(np.arange(len(things)), counts),
            "name": np.array([one.name for one in things], dtype=np.str_),
            "source": np.array([one.source for one in things], dtype=np.str_),
            "size": np.array([one.size for one in things], np.float32),
            "marker": np.array([one.marker for one in things], dtype=np.str_),
            "proposed": np.array(self.proposed, dtype=np.str_),
        }
        write_arrays(folder / FILE, arrays)


@dataclass(frozen=True, slots=True)
class NamedObject:
    """An object that was named as a known thing."""

    iri: str
    name: str
    likeness: float  # 1 for a mark; for a word, how much better it fits than absent ones


def remember_named(semantic_map: SemanticMap) -> None:
    """Keep the looks of the objects that people gave names of their own.

    A thing whose object is still there under another name is forgotten; one whose object is gone
    stays. Raises ModelError where the folder cannot be written.
    """
    folder = semantic_map.store.path
    if folder is None:
        return
    names = {
        a.subject: a.value
        for a in semantic_map.assertions.all()
        if a.property == "category" and a.by != AUTHOR and a.value.startswith(NAMED)
    }
    if not names and not (folder / FILE).is_file():
        return
    before = KnownThings.load(folder)
    records = {record.iri: record for record in semantic_map.perceived.objects()}
    kept = [one for one in before.things if one.source not in records]
    known = KnownThings(tuple(kept), before.proposed)
    looks = LookStore(folder, network()).of(names.keys() & records.keys())
    for iri, look in sorted(looks.items()):
        name = semantic_map.catalogue.label(names[iri])
        known = known.with_thing(KnownThing(name, features_of(look), iri, _size(records[iri])))
    known.save(folder)


def recognise(semantic_map: SemanticMap) -> tuple[NamedObject, ...]:
    """Name the objects that are known things, by a mark or by their looks; returns them.

    Each is an assertion of `AUTHOR` that is made once: where somebody retracts it, it stays so.
    Raises ModelError for damaged files of the folder.
    """
    folder = semantic_map.store.path
    if folder is None:
        return ()
    known, marked = KnownThings.load(folder), _marked(semantic_map)
    if not known.things and not marked:
        return ()
    records = (*semantic_map.objects(min_existence=BELIEVED), *semantic_map.unnamed_things())
    taken = {a.subject for a in semantic_map.assertions.all() if a.property == "category"}
    present = {_label(semantic_map, one.category) for one in records if one.iri in taken}
    wanted = [one for one in (*known.things, *marked) if one.name not in present]
    free = [one for one in records if one.iri not in taken]
    if not wanted or not free:
        return ()
    found, used = list[NamedObject](), set[str]()
    pairs = _pairs(folder, known, wanted, records, {one.iri for one in free})
    for _, one in sorted(pairs, key=lambda pair: (-pair[0], pair[1].iri, pair[1].name)):
        if not used & {one.iri, one.name}:
            used |= {one.iri, one.name}
            found.append(one)
    return propose(semantic_map, known, found)


def propose(
    semantic_map: SemanticMap, known: KnownThings, found: Iterable[NamedObject]
) -> tuple[NamedObject, ...]:
    """Give objects their names, each once, as assertions of `AUTHOR`; returns those that are made.

    Raises ModelError where the folder of the map cannot be written.
    """
    made = []
    for one in found:
        if f"{one.iri} {one.name}" in known.proposed:
            continue
        try:
            semantic_map.assertions.add(one.iri, "name", one.name, by=AUTHOR)
        except HereaboutsError:
            continue  # the object went meanwhile, or the name is a kind of place now
        made.append(one)
    if made and semantic_map.store.path is not None:
        proposed = (*known.proposed, *(f"{one.iri} {one.name}" for one in made))
        KnownThings(known.things, proposed[-10 * MAX_THINGS :]).save(semantic_map.store.path)
    return tuple(made)


MAX_NAMES: Final = 500  # of one list


def label_things(semantic_map: SemanticMap, names: Sequence[str]) -> tuple[NamedObject, ...]:
    """Name things without a name by those of `names` that they look most like; returns them.

    A thing that looks like none of them, by the threshold of the map's encoder, stays without a
    name. Names are asserted by "looks", each once: where somebody retracts one, it stays so.

    Raises ModelError: the map has no encoder, or the encoder does not know a name;
    InvalidFactError or UnknownCategoryError for a text that is no name of a thing.
    """
    folder = semantic_map.store.path
    if folder is None:
        raise ModelError("names are compared with pictures: the folder of a map would work")
    encoder = encoder_of(folder)
    if encoder is None:
        raise ModelError(
            "the map has no encoder to compare names with; one that is mapped with --encoder "
            "image.onnx,text.onnx would work"
        )
    wanted = list({name_key(name): checked_name(name) for name in names}.values())
    if not 0 < len(wanted) <= MAX_NAMES:
        raise ModelError(f"give 1 to {MAX_NAMES} names, got {len(wanted)}")
    for name in wanted:
        category_of_name(semantic_map.catalogue, name)  # refuses kinds of places
    texts = np.stack([encoder.pair.encode_text(name) for name in wanted])
    rows = looks_of(semantic_map, [one.iri for one in semantic_map.unnamed_things()], encoder)
    if not rows:
        return ()
    things = list(rows.values())
    absent = fits(things, encoder.negatives, encoder.negatives)
    least = np.maximum(absent.max(axis=1), least_fit(absent))  # it fits no absent word better
    fit = fits(things, texts, encoder.negatives)
    found = [
        NamedObject(iri, wanted[int(scores.argmax())], float(scores.max()))
        for iri, scores, enough in zip(rows, fit, least, strict=True)
        if scores.max() >= enough
    ]
    return propose(semantic_map, KnownThings.load(folder), found)


def _marked(semantic_map: SemanticMap) -> list[KnownThing]:
    """The categories that the ontology has a mark for, as things."""
    marks = marked_categories(semantic_map.engine)
    if not marks:
        return []
    from perception.inference.markers import marker_name  # loads OpenCV

    found = []
    for iri, mark in sorted(marks.items()):
        with suppress(ModelError):  # a mark that does not exist
            found.append(_without_looks(_label(semantic_map, iri), marker_name(mark)))
    return [one for one in found if one.name]


def _without_looks(name: str, marker: str) -> KnownThing:
    return KnownThing(name, np.zeros((0, len(feature_statistics()[0])), np.float32), marker=marker)


def _pairs(
    folder: Path,
    known: KnownThings,
    wanted: Sequence[KnownThing],
    records: Sequence[ObjectRecord],
    free: Collection[str],
) -> Iterator[tuple[float, NamedObject]]:
    """Pairs of a free object and a known thing that may be one, with how clear that is."""
    from perception.inference.markers import markers_in  # loads OpenCV

    marks = {one.marker: one.name for one in wanted if one.marker}
    pictures = ObjectPictures(folder)
    looks = LookStore(folder, network()).of(
        record.iri for record in sorted(records, key=lambda one: one.iri not in free)
    )
    for record in (one for one in records if one.iri in free):
        seen = set[str]()
        for path in pictures.views_of(record.iri) if marks else ():
            seen |= markers_in(path.read_bytes(), {mark.partition("/")[0] for mark in marks})
        for mark in seen & marks.keys():
            yield math.inf, NamedObject(record.iri, marks[mark], 1.0)
        if record.iri not in looks:
            continue
        features = features_of(looks[record.iri])
        for one in wanted:
            if one.source == record.iri or not len(one.features) or not _fits(one, record):
                continue
            alike = likeness(one.features, features)
            if alike < MIN_LIKENESS:
                continue
            before = [
                features_of(looks[r.iri])
                for r in records
                if r.iri in looks and r.iri != one.source and r.first_seen < record.first_seen
            ]
            named = [o.features for o in known.things if o.name != one.name and len(o.features)]
            rival = most_alike(features, [*before, *named])
            clear = alike if rival is None else 2 * alike - rival
            if clear >= MIN_DISTINCT:
                yield clear, NamedObject(record.iri, one.name, min(alike, 0.99))


def _fits(one: KnownThing, record: ObjectRecord) -> bool:
    """Whether the sizes of a known thing and an object are alike, where both are known."""
    ratio = _size(record) / one.size
    return math.isnan(ratio) or 1 / MAX_SIZE_RATIO <= ratio <= MAX_SIZE_RATIO


def _size(record: ObjectRecord) -> float:
    return math.nan if record.extent is None else float(np.max(record.extent))


def _label(semantic_map: SemanticMap, iri: str) -> str:
    known = semantic_map.catalogue.by_iri(iri)
    return "" if known is None else known.label


def taught(name: str, pictures: Iterable[bytes], marker: str = "") -> KnownThing:
    """A thing taught by JPEG or PNG pictures; raises RecordingError and ModelError for bad ones."""
    data = list(pictures)
    if not data:
        return _without_looks(name, marker)
    rows = np.stack([network().describe(picture) for picture in data])
    return KnownThing(name, features_of(rows), marker=marker)


#: log-likelihood ratio of one thing against two of a category, by how much more alike they look
#: than the new thing and the most similar other one: its value at 0, and its slope. Fitted to the
#: lounge and judged on the kitchen (lab/research/measurements.md).
EVEN: Final = 0.5
SLOPE: Final = 6.9
_MAX_LOG_RATIO: Final = 3.0  # of the log-likelihood ratio, either way
_KEPT: Final = 1000  # things in memory


class MovedLooks:
    """Compares tracks by their pictures: those in the folder of a map, or of recent frames."""

    def __init__(self, folder: Path, recent: Callable[[Evidence], bytes | None]) -> None:
        self._pictures, self._recent = ObjectPictures(folder), recent
        self._known = dict[tuple[str | int, str], Floats | None]()  # by thing and best frame

    def ratio(self, old: Track, new: Track, others: Sequence[Track]) -> float:
        """Likelihood ratio of `new` being `old` and being another thing, by their looks.

        `others` are further things of the category that were known before `new`. 1 where any has
        no picture: without others, nothing tells how alike things of the category are here.
        """
        if not others:
            return 1.0
        a, b = self._features(old), self._features(new)
        if a is None or b is None:
            return 1.0
        known = (self._features(other) for other in others)
        rival = most_alike(b, (one for one in known if one is not None))
        if rival is None:
            return 1.0
        log_ratio = EVEN + SLOPE * (likeness(a, b) - rival)
        return math.exp(min(max(log_ratio, -_MAX_LOG_RATIO), _MAX_LOG_RATIO))

    def _features(self, track: Track) -> Floats | None:
        """(n, F) features of a track's views; None without any."""
        # another best observation of it brings another picture
        key = track.iri or track.number, "" if track.best is None else track.best.frame
        if key not in self._known:
            rows = [described(network(), data) for data in self._views(track)]
            shown = [row for row in rows if np.isfinite(row).all()]
            self._known[key] = features_of(np.stack(shown)) if shown else None
            if len(self._known) > _KEPT:
                del self._known[next(iter(self._known))]
        return self._known[key]

    def _views(self, track: Track) -> Iterator[bytes]:
        paths = self._pictures.views_of(track.iri) if track.iri is not None else []
        for path in paths:
            with suppress(OSError):  # removed meanwhile
                yield read_bytes(path, MAX_BYTES)
        if not paths and track.best is not None:
            data = self._recent(track.best)
            if data is not None:
                yield data
