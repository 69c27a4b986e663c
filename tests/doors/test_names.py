"""A thing has the same names at every door, and what people write keeps the words they used."""

import json
from collections.abc import Callable, Iterator

import pytest
import requests

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError
from tests.doors.doors import PATIENCE, House, RefusedError, answered, command, open_house, tool
from tests.doors.stating_doors import ASSERTING
from tests.planner.flat import fill

CUP, BED = "object/2", "object/3"
#: each form in which the cup with the label "the red cup" may be named, beside another cup
FORMS = (CUP, "IRI", "the red cup", "red cup", "The  Red Cup")


def furnish(semantic_map: SemanticMap) -> None:
    fill(semantic_map)
    semantic_map.update(
        "INSERT DATA { <object/9> a here:Cup ; here:x 2.0 ; here:y 2.5 ; here:inPlace <place/1> }",
        by="ann",
    )
    semantic_map.assertions.add(CUP, "label", "the red cup", by="ann")


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    with open_house(tmp_path_factory.mktemp("names"), furnish) as opened:
        yield opened


def _known(house: House, name: str) -> str:
    (known,) = json.loads(command("find", house.folder, name, "--from", "6,1", "--json"))["known"]
    return str(known["iri"])


def _listed(house: House, name: str) -> str:
    """The thing whose neighbours are listed: all others within 100 m."""
    near = tool(house, "list_things", near=name, radius=100, least=0, limit=100)["things"]
    everything = tool(house, "list_things", least=0, limit=100)["things"]
    (left,) = {one["id"] for one in everything} - {one["id"] for one in near}
    return str(left)


def _asserted(house: House, name: str) -> str:
    """The subject of what is asserted of a thing, by HTTP."""
    url = f"{house.server.url}assertions"
    answer = requests.get(url, {"iri": name}, headers={"Accept": "application/json"}, timeout=30)
    if not answer.ok:
        raise RefusedError(answer.text)
    return str(answer.json()["assertions"][0]["thing"])


DOORS: dict[str, Callable[[House, str], str]] = {
    "python": lambda house, name: house.map.resolve("iri", name),
    "python assertions": lambda house, name: house.map.assertions.all(name)[0].subject,
    "http assertions": _asserted,
    "find": _known,
    "why": lambda house, name: json.loads(command("why", house.folder, name, "--json"))[0]["iri"],
    "ask": lambda house, name: json.loads(
        command("ask", house.folder, "whereabouts", "-p", f"object={name}", "--json")
    )[0]["object"],
    "question": lambda house, name: json.loads(
        command("ask", house.folder, f"where is {name}", "--json")
    )["parameters"]["object"],
    "agents where_is": lambda house, name: tool(house, "where_is", what=name)["things"][0]["id"],
    "agents find_plan": lambda house, name: tool(house, "find_plan", what=[name])["known"][0]["id"],
    "agents list_things": _listed,
    "agents assert": lambda house, name: tool(
        house, "assert_fact", thing=name, property="label", value="the red cup"
    )["thing"],
}


@pytest.mark.parametrize(
    ("door", "form"),
    # a question has words
    [(door, form) for form in FORMS for door in DOORS if (door, form) != ("question", "IRI")],
)
def test_each_form_of_a_name_means_one_thing(house: House, door: str, form: str) -> None:
    name = house.map.base + CUP if form == "IRI" else form
    found = DOORS[door](house, name)
    assert found.removeprefix(house.map.base) == CUP


@pytest.mark.parametrize("door", ["python", "why", "ask", "agents list_things"])
def test_the_only_thing_of_a_kind_needs_no_other_name(house: House, door: str) -> None:
    assert DOORS[door](house, "the bed").removeprefix(house.map.base) == BED
    with pytest.raises(Exception, match=r"give one of cup 9, the red cup|give one of the red cup"):
        DOORS[door](house, "a cup")


@pytest.mark.parametrize("door", DOORS)
def test_a_number_that_no_thing_has_is_refused(house: House, door: str) -> None:
    with pytest.raises(Exception, match="there are: cup 9"):
        DOORS[door](house, "cup 99")


def test_a_status_is_that_of_the_thing_however_it_is_named(house: House) -> None:
    for name in (CUP, "the red cup", "Red cup"):
        answer = json.loads(command("status", house.folder, name, "--json"))
        assert (answer["value"], answer["places"]) == ("present", [])
        assert tool(house, "status", what=name)["status"] == "present"


def _in_place(answer: object) -> set[str]:
    return {str(row["object"]).removeprefix("object/") for row in json.loads(str(answer))}


#: the numbers of the objects in a place that is named
IN_PLACE: dict[str, Callable[[House, str], set[str]]] = {
    "python": lambda house, name: {
        one.iri.rpartition("/")[2] for one in house.map.objects(place=name)
    },
    "python query": lambda house, name: {
        str(row["object"]).rpartition("/")[2]
        for row in house.map.query("objects-in-place", place=name).records()
    },
    "ask": lambda house, name: _in_place(
        command("ask", house.folder, "objects-in-place", "-p", f"place={name}", "--json")
    ),
    "question": lambda house, name: _in_place(
        json.dumps(json.loads(command("ask", house.folder, f"what is in {name}", "--json"))["rows"])
    ),
    "agents list_things": lambda house, name: {
        str(one["id"]).rpartition("/")[2]
        for one in tool(house, "list_things", inside=name, least=0, limit=100)["things"]
    },
}


@pytest.mark.parametrize("door", IN_PLACE)
def test_a_place_has_the_names_that_answers_print(house: House, door: str) -> None:
    inside = IN_PLACE[door](house, "place 1")
    assert inside
    for name in ("kitchen", "The Kitchen", "place 1 (kitchen)", "place/1", "1"):
        if door != "question" or name.lower().endswith("kitchen"):  # a question has words
            assert IN_PLACE[door](house, name) == inside, name
    with pytest.raises(Exception, match=r"there are: place 1 \(kitchen\)"):
        IN_PLACE[door](house, "cellar")


def test_a_note_is_put_on_a_place_by_its_kind(house: House) -> None:
    for number, name in enumerate(("kitchen", "the kitchen", "place 1 (kitchen)")):
        command("assert", house.folder, name, "note", f"closed {number}", "--by", "ann")
        house.map.assertions.add(name, "note", f"closed {number}", by="ann")
        (note,) = [one for one in house.map.assertions.all(name) if one.property == "note"]
        assert (note.subject, note.value) == (house.map.place_iri(1), f"closed {number}")
    house.map.assertions.retract(house.map.place_iri(1), "note", by="ann")


RENAMED: dict[str, Callable[[House, str, str], object]] = {
    "python": lambda house, place, name: house.map.assertions.add(place, "name", name, by="ann"),
    "command line": lambda house, place, name: command(
        "assert", house.live, place, "name", name, "--by", "ann"
    ),
    "agents": lambda house, place, name: tool(
        house, "assert_fact", thing=place, property="name", value=name
    ),
    "http": lambda house, place, name: answered(
        requests.post(
            f"{house.server.url}assertions",
            json={"thing": place, "property": "name", "value": name},
            headers=house.bearer,
            timeout=PATIENCE,
        )
    ),
}


@pytest.mark.parametrize("door", RENAMED)
def test_the_name_of_a_place_is_its_label(house: House, door: str) -> None:
    RENAMED[door](house, "kitchen", f"cookery of {door}")
    place = house.map.place_iri(1)
    assert house.map.places("kitchen")[0].label == f"cookery of {door}"
    assert house.map.resolve("place", f"the cookery of {door}") == place
    house.map.assertions.retract(place, "name")
    assert house.map.places("kitchen")[0].label == "place 1"


def test_a_command_names_a_place(house: House) -> None:
    command("name", house.folder, "kitchen", "cookery", "--by", "ann")
    rows = json.loads(command("rooms", house.folder, "--json"))
    assert [row["label"] for row in rows if row["place"] == "place/1"] == ["cookery"]
    command("retract", house.folder, "cookery", "name")


def test_ways_lead_to_things_and_places_by_the_same_names(house: House) -> None:
    ends = [tool(house, "route", to=name)["end"] for name in ("kitchen", "place 1", "place/1", "1")]
    assert ends == ends[:1] * 4
    to_cup = [tool(house, "route", to=name)["end"] for name in FORMS if name != "IRI"]
    assert to_cup == to_cup[:1] * len(to_cup)


def test_an_undeclared_term_is_told(house: House) -> None:
    query = "SELECT ?s WHERE { ?s here:posX ?x }"
    assert "here:posX" in house.map.query(query).notes[0]
    assert "here:posX" in tool(house, "ask_sparql", query=query)["notes"][0]
    assert house.map.query("SELECT ?s WHERE { ?s here:heading 99 }").notes == ()


RESTORING: dict[str, Callable[[House, str, str], int]] = {
    "python": lambda house, name, when: (
        house.map.restore(when, only=[name], by="ann", dry_run=True).added
    ),
    "http": lambda house, name, when: int(
        answered(
            requests.post(
                f"{house.server.url}restore",
                json={"to": when, "only": [name], "dry_run": True},
                headers=house.bearer,
                timeout=PATIENCE,
            )
        ).json()["added"]
    ),
    "beside the writer": lambda house, name, when: int(
        json.loads(
            command(
                *("restore", house.live, "--to", when, "--only", name),
                *("--by", "ann", "--dry-run", "--json"),
            )
        )["added"]
    ),
}


@pytest.mark.parametrize("door", RESTORING)
def test_a_thing_is_restored_by_its_name_now_or_then(house: House, door: str) -> None:
    add = house.map.assertions.add
    add(BED, "label", "the cot", by="ann")
    before = f"#{house.map.sequence}"
    add(BED, "label", "the daybed", by="ann")
    add("object/9", "label", "another change", by="ann")
    try:
        counts = {RESTORING[door](house, one, before) for one in (BED, "the cot", "the daybed")}
        assert len(counts) == 1 and counts.pop() > 0
        with pytest.raises(Exception, match="nothing to restore is called"):
            RESTORING[door](house, "a thing of no name", before)
    finally:
        for thing in (BED, "object/9"):
            house.map.assertions.retract(thing, "label", by="ann")


# --- coordinates by people: millimetres, and starts off the floor ---


MILLIMETRES: dict[str, Callable[[House], object]] = {
    "update": lambda house: house.map.update(
        "INSERT DATA { <object/77> a here:Cup ; here:x 3000.0 ; here:y 900.0 }", by="ann"
    ),
    "http update": lambda house: _ok(
        requests.post(
            house.sparql,
            "INSERT DATA { <object/77> a here:Cup ; here:x 3000.0 ; here:y 900.0 }",
            headers={"Content-Type": "application/sparql-update", **house.bearer},
            timeout=PATIENCE,
        )
    ),
    "graph store": lambda house: _ok(
        requests.post(
            f"{house.server.url}graphs/map",
            "<object/77> a <https://w3id.org/hereabouts#Cup> ; "
            "<https://w3id.org/hereabouts#x> 3000.0 ; <https://w3id.org/hereabouts#y> 900.0 .",
            headers={"Content-Type": "text/turtle", **house.bearer},
            timeout=PATIENCE,
        )
    ),
    "rooms": lambda house: _ok(
        requests.post(
            f"{house.server.url}rooms",
            json={"kind": "draw", "places": [], "name": "x",
                  "points": [[3000, 0], [5000, 0], [5000, 2000]]},
            headers=house.bearer,
            timeout=PATIENCE,
        )
    ),
    "find": lambda house: command("find", house.folder, "cup", "--from", "3000,900"),
    "find nearest-first": lambda house: command(
        "find", house.folder, "cup", "--from", "3000,900", "--rule", "nearest-first"
    ),
    "agents find_plan": lambda house: tool(house, "find_plan", what=["cup"], x=3000, y=900),
    "agents next_look": lambda house: tool(house, "next_look", what=["cup"], x=3000, y=900),
    "agents route": lambda house: tool(house, "route", to="bed", x=3000, y=900),
    "agents list_things": lambda house: tool(house, "list_things", x=3000, y=900),
}  # fmt: skip


def _ok(answer: requests.Response) -> None:
    assert answer.ok, answer.text


@pytest.mark.parametrize("door", MILLIMETRES)
def test_points_in_millimetres_are_refused(house: House, door: str) -> None:
    before = house.map.sequence
    with pytest.raises(Exception, match="are these millimetres"):
        MILLIMETRES[door](house)
    assert house.map.sequence == before


def test_what_is_only_odd_is_taken_with_a_line(house: House) -> None:
    change = house.map.assertions.add(BED, "position", "40 2 0.5", by="ann")
    assert change is not None and "is 28 m from all that the map knows" in change.notes[0]
    house.map.assertions.retract(BED, "position", by="ann")
    plan = tool(house, "find_plan", what=["cup"], x=20, y=2)
    assert "off the floor" in plan["note"]
    assert "off the floor" in tool(house, "route", to="bed", x=20, y=2)["notes"][0]
    answer = json.loads(command("find", house.folder, "cup", "--from", "20,2", "--json"))
    assert "off the floor" in answer["notes"][0]


# --- whose edit it is ---


def test_the_second_person_is_told_whose_value_was_replaced(house: House) -> None:
    house.map.assertions.add(BED, "label", "my bed", by="bob")
    told = {
        "python": lambda: house.map.assertions.add(BED, "label", "a bed", by="ann").notes,
        "http": lambda: requests.post(
            f"{house.server.url}assertions",
            json={"thing": BED, "property": "label", "value": "a bed"},
            headers=house.bearer,
            timeout=PATIENCE,
        ).json()["notes"],
        "agents": lambda: tool(
            house, "assert_fact", thing=BED, property="label", value="a bed"
        )["untrusted_notes"],
        "update": lambda: house.map.update(
            f"DELETE {{ <{BED}> rdfs:label ?l }} INSERT {{ <{BED}> rdfs:label 'a bed' }} "
            f"WHERE {{ GRAPH graph:map {{ <{BED}> rdfs:label ?l }} }}",
            by="ann",
        ).notes,
    }  # fmt: skip
    for door, write in told.items():
        (note,) = write()
        assert "that bob asserted" in note and "was replaced: my bed" in note, door
        house.map.assertions.add(BED, "label", "my bed", by="bob")
    house.map.assertions.retract(BED, "label", by="bob")


@pytest.mark.parametrize("door", ["python", "http", "agents"])
def test_an_undo_takes_back_one_s_own_edit_alone(house: House, door: str) -> None:
    undo: dict[str, Callable[[], object]] = {
        "python": lambda: house.map.assertions.retract(BED, "category", by="ann"),
        "http": lambda: _ok(
            requests.delete(
                f"{house.server.url}assertions",
                params={"iri": BED, "property": "category"},
                headers=house.bearer,
                timeout=PATIENCE,
            )
        ),
        "agents": lambda: tool(house, "retract", thing=BED, property="category"),
    }
    house.map.assertions.add(BED, "name", "my cot", by="ann")
    house.map.assertions.add(BED, "name", "daybed", by="bob")
    with pytest.raises(Exception, match="is by bob now"):
        undo[door]()
    (kept,) = (a for a in house.map.assertions.all(BED) if a.property == "category")
    assert kept.by == "bob"
    house.map.assertions.retract(BED, "category", by="bob")


def test_an_edit_that_names_an_older_state_is_refused(house: House) -> None:
    url = f"{house.server.url}assertions"
    read = requests.get(url, headers={"Accept": "application/json"}, timeout=PATIENCE)
    house.map.assertions.add(BED, "label", "my bed", by="bob")
    given = {"thing": BED, "property": "label", "value": "ann's bed"}
    headers = house.bearer | {"If-Match": read.headers["ETag"]}
    assert requests.post(url, json=given, headers=headers, timeout=PATIENCE).status_code == 412
    headers["If-Match"] = requests.get(url, headers={"Accept": "application/json"}).headers["ETag"]
    assert requests.post(url, json=given, headers=headers, timeout=PATIENCE).ok
    house.map.assertions.retract(BED, "label", by="ann")


# --- names that people give ---


def test_a_name_stays_as_it_was_given_everywhere(house: House) -> None:
    house.map.assertions.add(CUP, "name", "my blue mug", by="bob")
    try:
        rows = house.map.query("objects", least=0).records()
        (row,) = (row for row in rows if row["object"] == house.map.base + CUP)
        assert row["category"] == "my blue mug"
        told = tool(house, "where_is", what="my blue mug")["things"][0]
        assert told["untrusted_category_by"] == "bob"
        assert told["untrusted_detected_as"] == "cup"
        plan = tool(house, "find_plan", what=["my blue mug"])
        texts = json.dumps([plan, tool(house, "status", what="my blue mug")])
        assert "a my blue mug" not in texts and "my blue mug 2" not in texts
        assert "detected there as cup" in plan["untrusted_answer"][0]
    finally:
        house.map.assertions.retract(CUP, "category", by="bob")


@pytest.mark.parametrize("door", ASSERTING)
def test_a_name_outranks_the_label_of_an_earlier_one(house: House, door: str) -> None:
    """And whoever gave the earlier one takes back no label that replaced it."""
    assertions = house.map.assertions
    assertions.add("object/9", "name", "\u2615 mug", by="zoe")
    if door != "command line":  # which writes to the copy
        ASSERTING[door](house, "object/9", "name", "blue mug")
        stated = {one.property: one.value for one in assertions.all("object/9")}
        assert stated["label"] == "blue mug"
    assertions.add("object/9", "label", "cup of bob", by="bob")
    with pytest.raises(InvalidFactError, match="after that of zoe"):
        assertions.retract("object/9", "label", by="zoe")


def test_a_note_has_the_words_and_the_time_of_what_it_replaces(house: House) -> None:
    assertions = house.map.assertions
    assertions.add(BED, "name", "zoe tool", by="zoe")
    change = assertions.add(BED, "category", "chair", by="bob")
    assert change is not None
    (line,) = change.notes
    assert "zoe tool" in line
    assert "days" not in line
