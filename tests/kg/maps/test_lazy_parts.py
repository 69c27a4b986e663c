"""Parts of a map are made at their first use, once for all threads."""

import threading
import time

from kg.maps.map_parts import lazy
from kg.model.records import MapUpdate
from kg.serving.opening import create_map, in_memory_map, open_map

WRITERS = {"_writer", "assertions", "rooms", "ontology", "subscriptions", "surface_store"}


class Owner:
    made = 0
    part: object = lazy(lambda self: self.make())

    def make(self) -> object:
        time.sleep(0.02)  # others ask meanwhile
        self.made += 1
        return object()


def test_many_threads_get_one_part() -> None:
    owner, found = Owner(), list[object]()
    threads = [threading.Thread(target=lambda: found.append(owner.part)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert owner.made == 1
    assert len(found) == 8 and len(set(map(id, found))) == 1
    assert not hasattr(Owner, "part"), "it belongs to an instance"


def test_an_assigned_part_stays() -> None:
    owner = Owner()
    owner.part = "given"
    assert (owner.part, owner.made) == ("given", 0)


def test_a_question_makes_no_writers() -> None:
    with in_memory_map() as semantic_map:
        semantic_map.query("objects")
        semantic_map.objects()
        assert not WRITERS & vars(semantic_map).keys()
        semantic_map.apply(MapUpdate())
        assert vars(semantic_map).keys() & WRITERS == {"_writer"}


def test_the_surface_has_the_transaction_of_the_opening(tmp_path) -> None:
    """Frames of transactions that a crash lost stay lost, though others were committed since."""
    with create_map(tmp_path / "a.map") as semantic_map:
        opened_at = semantic_map.sequence
        semantic_map.describe(title="another", by="ann")
        assert semantic_map.sequence > opened_at
        assert semantic_map.surface_store._sequence == opened_at
    with open_map(tmp_path / "a.map", read_only=True) as semantic_map:
        assert semantic_map.surface_store._sequence == opened_at + 1
