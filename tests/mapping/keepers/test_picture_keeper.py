import os

import cv2
import numpy as np
import pytest

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.model.records import DepartedRecord, MapUpdate
from kg.serving.opening import create_map, open_map
from mapping.keepers.picture_keeper import PictureKeeper
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.annotate import MAX_SIDE, object_picture
from perception.frames import Frame

BOX = (20.0, 14.0, 44.0, 34.0)
RED = (200, 30, 30)
CHECKERED = (np.indices((49, 65)).sum(0) // 2 % 2 * 255).astype(np.uint8)


@pytest.fixture
def coloured(step_back):
    """Callable: number -> a view of a wall with something red on it."""

    def view(number: int) -> Frame:
        frame = step_back(number)
        frame.rgb[14:34, 20:44] = RED
        return frame

    return view


def decoded(data: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]


def mapped(folder, coloured, detections, **options):
    with (
        create_map(folder, base="https://example.org/map/") as semantic_map,
        Mapper(semantic_map, MappingOptions(**options), recording="room") as mapper,
    ):
        for number in range(3):
            mapper.add(coloured(number), detections)
        objects = semantic_map.objects()
        return objects, [ObjectPictures(folder).path_of(one) for one in objects]


def test_each_object_has_the_picture_of_its_best_observation(tmp_path, coloured, make_detections):
    (cup,), (path,) = mapped(tmp_path / "a.map", coloured, make_detections(("cup", 0.9, BOX)))
    assert path.parent == tmp_path / "a.map" / "pictures"
    picture = decoded(path.read_bytes())
    middle = picture[picture.shape[0] // 2, picture.shape[1] // 2].astype(int)
    assert np.abs(middle - RED).max() < 30
    assert max(picture.shape) <= MAX_SIDE and path.stat().st_size <= MAX_BYTES
    assert cup.evidence is not None


def test_no_picture_is_kept_of_a_person(tmp_path, coloured, make_detections):
    (person,), pictures = mapped(
        tmp_path / "a.map", coloured, make_detections(("person", 0.9, BOX))
    )
    assert person.category.endswith("#Person")
    assert pictures == [None]
    assert not (tmp_path / "a.map" / "pictures").exists()


def test_pictures_can_be_left_out(tmp_path, coloured, make_detections):
    detections = make_detections(("cup", 0.9, BOX))
    _, pictures = mapped(tmp_path / "a.map", coloured, detections, pictures=False)
    assert pictures == [None]


def test_a_folder_that_cannot_be_written_does_not_stop_the_mapping(
    tmp_path, coloured, make_detections
):
    folder = tmp_path / "a.map"
    with create_map(folder, base="https://example.org/map/") as semantic_map:
        (folder / "pictures").write_text("in the way")
        mapper = Mapper(semantic_map)
        for number in range(3):
            mapper.add(coloured(number), make_detections(("cup", 0.9, BOX)))
        assert len(semantic_map.objects()) == 1


def test_people_in_a_picture_are_made_unrecognisable():
    rgb = np.repeat(CHECKERED[:, :, None], 3, axis=2)
    everybody = np.array([[0, 0, 65, 49]], np.float32)
    nobody = np.zeros((0, 4), np.float32)
    sharp = decoded(object_picture(rgb, BOX, nobody, MAX_BYTES))
    coarse = decoded(object_picture(rgb, BOX, everybody, MAX_BYTES))
    assert sharp.std() > 60
    assert coarse.std() < sharp.std() / 3


def test_what_may_be_a_person_leaves_a_thing_as_it_is(tmp_path, step_back, make_detections):
    def checkered(number: int) -> Frame:
        frame = step_back(number)
        frame.rgb[14:34, 20:44] = CHECKERED[14:34, 20:44, None]
        return frame

    sharp = {}
    for score in (0.3, 0.6):
        seen = make_detections(("couch", 0.95, BOX), ("person", score, (0.0, 0.0, 60.0, 48.0)))
        _, paths = mapped(tmp_path / f"{score}.map", checkered, seen)
        (path,) = [path for path in paths if path is not None]
        sharp[score] = decoded(path.read_bytes()).std()
    assert sharp[0.3] > 1.5 * sharp[0.6]


def test_a_view_in_which_a_person_covers_the_thing_does_not_replace_another(
    tmp_path, coloured, make_detections
):
    free = make_detections(("cup", 0.9, BOX))
    covered = make_detections(("cup", 0.97, BOX), ("person", 0.6, BOX))
    with (
        create_map(tmp_path / "a.map", base="https://example.org/map/") as semantic_map,
        Mapper(semantic_map, MappingOptions(), recording="room") as mapper,
    ):
        for number in range(3):
            mapper.add(coloured(number), free)
        mapper.add(coloured(3), covered)
        (cup,) = (one for one in semantic_map.objects() if one.category.endswith("#Cup"))
        assert cup.evidence is not None and cup.evidence.score == pytest.approx(0.97, abs=0.01)
        picture = decoded(ObjectPictures(tmp_path / "a.map").read(cup))
    middle = picture[picture.shape[0] // 2, picture.shape[1] // 2].astype(int)
    assert np.abs(middle - RED).max() < 30
    assert len(files_of(tmp_path / "a.map", 1)) == 1


def test_a_picture_that_cannot_be_small_enough_is_none():
    noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    nobody = np.zeros((0, 4), np.float32)
    assert object_picture(noise, (0.0, 0.0, 640.0, 480.0), nobody, 500) is None


def test_pictures_of_others_are_not_dropped(tmp_path, monkeypatch):
    monkeypatch.setattr("kg.maps.object_pictures.MAX_PICTURES", 1)
    (tmp_path / "pictures").mkdir()
    for name in ("1-0123abcd.jpg", "2-0123abcd.jpg", "holiday.jpg", "holiday-2.jpg"):
        (tmp_path / "pictures" / name).write_bytes(b"")
    ObjectPictures(tmp_path).limit()
    left = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert left >= {"holiday.jpg", "holiday-2.jpg"} and len(left) == 3


def files_of(folder, number: int) -> list[str]:
    iri = f"https://example.org/map/object/{number}"
    return [path.name for path in ObjectPictures(folder).views_of(iri)]


def test_joined_objects_keep_the_best_views_of_both(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for age, (number, key) in enumerate([(1, "a"), (1, "b"), (1, "c"), (2, "d"), (2, "e")]):
        path = folder / f"{number}-{key * 8}.jpg"
        path.write_bytes(key.encode())
        os.utime(path, ns=(10**9 - age, 10**9 - age))
    pictures = ObjectPictures(tmp_path)
    pictures.join("https://example.org/map/object/1", "https://example.org/map/object/2")
    assert files_of(tmp_path, 1) == [f"1-{key * 8}.jpg" for key in "adbe"]
    assert files_of(tmp_path, 2) == [] and len(list(folder.iterdir())) == 4


def test_pictures_of_an_object_stay_where_it_left_and_follow_it(
    tmp_path, coloured, make_detections
):
    folder = tmp_path / "a.map"
    (cup,), _ = mapped(folder, coloured, make_detections(("cup", 0.9, BOX)))
    later = cup.iri.replace("object/1", "object/7")
    left = DepartedRecord(
        *(cup.iri, cup.category, cup.p_map, 0.9, 3), *(cup.first_seen, cup.last_seen, cup.last_seen)
    )
    with open_map(folder) as semantic_map:
        keeper = PictureKeeper(semantic_map, "room")
        keeper.keep(MapUpdate(removed=(cup.iri,), departed=(left,)))
        assert files_of(folder, 1)
        keeper.keep(MapUpdate(removed=(cup.iri,)), [(cup.iri, later)])
        assert files_of(folder, 7) and not files_of(folder, 1)
        keeper.keep(MapUpdate(removed=(later,)))
        assert not files_of(folder, 7)
