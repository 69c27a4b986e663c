"""Maps whose objects have pictures cut from photographs."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.model.records import Evidence, MapUpdate
from kg.serving.opening import create_map
from perception.annotate import object_picture

#: photograph of COCO val2017, and a box (xyxy) [px]
SHOWN = {
    "teddy bear": ("000000000776", (95.0, 6.0, 427.0, 551.0)),
    "other bear": ("000000000776", (3.0, 278.0, 320.0, 632.0)),
    "banana": ("000000008844", (544.0, 259.0, 638.0, 393.0)),
    "other banana": ("000000012667", (284.0, 49.0, 448.0, 290.0)),
    "cup": ("000000002592", (223.0, 35.0, 433.0, 248.0)),
    "wine glass": ("000000002431", (308.0, 1.0, 430.0, 210.0)),
}
NOBODY = np.zeros((0, 4), np.float32)


@pytest.fixture
def cut_out(shared):
    """Callable: name of `SHOWN`, pixels by which the box is moved -> JPEG of the thing."""

    def cut(name: str, moved: float = 0.0) -> bytes:
        number, box = SHOWN[name]
        path = shared(f"data/images/coco_val64/images/{number}.jpg")
        rgb = np.ascontiguousarray(cv2.imread(str(path))[:, :, ::-1])
        data = object_picture(rgb, tuple(v + moved for v in box), NOBODY, MAX_BYTES)
        assert data is not None
        return data

    return cut


@pytest.fixture
def furnished(tmp_path, make_object):
    """Callable: (category, picture) ... -> a new map on disk with such objects, open."""
    made = []

    def furnish(*things: tuple[str, bytes], name: str = "home.map"):
        semantic_map = create_map(tmp_path / name, base=f"https://example.org/{name}/")
        made.append(semantic_map)
        add_things(semantic_map, make_object, *things)
        return semantic_map

    yield furnish
    for semantic_map in made:
        semantic_map.close()


def add_things(semantic_map, make_object, *things, recording="room", first_seen=0.0):
    """Add objects with pictures, first seen so many seconds later; returns their IRIs."""
    records = []
    for place, (category, _) in enumerate(things):
        iri = semantic_map.catalogue.find(category, "object").iri
        record = make_object(1, iri, (float(place), 0.0, 0.5), confidence=3.0)
        shown = Evidence(recording, f"frame-{place}", 0.0, (0.0, 0.0, 9.0, 9.0), 0.9, "network")
        first, last = (t + first_seen for t in (record.first_seen, record.last_seen))
        record = replace(record, evidence=shown, first_seen=first, last_seen=last)
        records.append(replace(record, iri=semantic_map.new_object_iri()))
    semantic_map.apply(MapUpdate(tuple(records)))
    pictures = ObjectPictures(semantic_map.store.path)
    for record, (_, picture) in zip(records, things, strict=True):
        pictures.write(record, picture)
    return [record.iri for record in records]
