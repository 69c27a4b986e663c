"""The scripts of `test_corrections`: how people and perception agree and contradict.

One camera looks along x. A script is steps separated by ``;``:

    see LABEL [left|right] [D]   the detector finds one at depth D [m], 2 unless said
    look                         nothing is detected, though all the room is visible
    blind                        nothing is detected, and all is hidden
    view CATEGORY                the scene network is sure of a category
    say THING PROPERTY VALUE     somebody asserts; ``unsay THING PROPERTY`` retracts
    delete THING, move N X Y, retype THING CATEGORY, add N CATEGORY X Y,
    rethink CATEGORY BELIEF VIEWS
                                 the same by SPARQL Update
    restart                      the run ends and another begins

and after it the map must be as told: objects as ``N CATEGORY X Y``, with ``!`` behind those that
are believed gone; the place's category; and what is in conflict.
"""

from typing import NamedTuple


class Script(NamedTuple):
    name: str
    steps: str
    objects: str = ""
    place: str | None = None
    conflicts: str = ""


SCRIPTS = (
    # without people
    Script("a cup is seen", "see cup", "1 cup 2 0"),
    Script("a cup is seen, then missed twice", "see cup; look; look"),
    Script("a cup outlives a restart", "see cup; restart; see cup", "1 cup 2 0"),
    Script("two cups apart", "see cup left; see cup right", "1 cup 2 1.04, 2 cup 2 -1.04"),
    # deleted by hand
    Script("deleted, it stays deleted", "see cup; delete object/1; blind; blind"),
    Script("deleted and seen again, it is new", "see cup; delete object/1; see cup", "2 cup 2 0"),
    Script(
        "deleting one leaves the other",
        "see cup left; see cup right; delete object/1; blind",
        "2 cup 2 -1.04",
    ),
    Script(
        "deleted with all that was said of it",
        "see cup; say object/1 category bowl; delete object/1; see cup",
        "2 cup 2 0",
    ),
    # moved by hand
    Script("moved, it stays where it was put", "see cup; move 1 3 0; blind", "1 cup 3 0"),
    Script("moved, it is found where it was put", "see cup; move 1 3 0; see cup 3", "1 cup 3 0"),
    Script(
        "moved, the old spot is another cup's",
        "see cup; move 1 3 0; see cup 2",
        "1 cup 3 0, 2 cup 2 0",
    ),
    Script("moved a little, the mean goes on", "see cup; move 1 2.4 0; see cup", "1 cup 2.2 0"),
    # added by hand
    Script("added, it is there", "blind; add 7 cup 2 0; blind", "7 cup 2 0"),
    Script("added, it is the one that is seen", "add 7 cup 2 0; see cup", "7 cup 2 0"),
    Script("added numbers are not used again", "add 7 cup 3 2; see cup", "7 cup 3 2, 8 cup 2 0"),
    Script("added, it fades when missed", "add 7 cup 2 0; look; look; look"),
    # an object's category
    Script(
        "corrected, it sticks",
        "see cup; say object/1 category bowl; see cup; see cup",
        "1 bowl 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected, both names are its own",
        "see cup; say object/1 category bowl; see bowl; see cup",
        "1 bowl 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected and taken back",
        "see cup; say object/1 category bowl; see cup; unsay object/1 category",
        "1 cup 2 0",
    ),
    Script(
        "corrected twice, the last counts",
        "see cup; say object/1 category bowl; say object/1 category vase; see cup",
        "1 vase 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected, it still leaves when it is gone",
        "see cup; say object/1 category bowl; look; look",
    ),
    Script(
        "taken back, other names are others again",
        "see cup; say object/1 category bowl; unsay object/1 category; see bowl",
        "1 cup 2 0, 2 bowl 2 0",
    ),
    # an object's position
    Script(
        "put elsewhere, it sticks",
        "see cup; say object/1 position 4 2 0; see cup",
        "1 cup 4 2",
        conflicts="object/1 position",
    ),
    Script(
        "put elsewhere, what is seen there is it",
        "see cup; say object/1 position 3 0 1; see cup 3",
        "1 cup 3 0",
    ),
    Script(
        "put elsewhere and taken back: perception's mean, kept up",
        "see cup; say object/1 position 4 2 0; see cup 2.4; unsay object/1 position",
        "1 cup 2.2 0",
    ),
    Script(
        "put elsewhere, it is not missed where it was",
        "see cup; say object/1 position 4 9 0; look; look; look",
        "1 cup 4 9",
        conflicts="object/1 position",
    ),
    # whether it is there
    Script(
        "said to be absent, it is believed gone though seen",
        "see cup; say object/1 existence absent; see cup",
        "1 cup 2 0!",
        conflicts="object/1 existence",
    ),
    Script(
        "said to be absent, taken back",
        "see cup; say object/1 existence absent; see cup; unsay object/1 existence",
        "1 cup 2 0",
    ),
    Script(
        "said to be present, it stays though missed",
        "see cup; say object/1 existence present; look; look; look",
        "1 cup 2 0",
        conflicts="object/1 existence",
    ),
    Script(
        "said to be present, taken back after it was missed",
        "see cup; say object/1 existence present; look; look; look; unsay object/1 existence",
    ),
    # what kind of place it is
    Script("a kitchen is viewed", "view kitchen", place="kitchen"),
    Script(
        "an asserted place sticks",
        "view kitchen; say place/1 category bedroom; view kitchen",
        place="bedroom",
        conflicts="place/1 category",
    ),
    Script(
        "a place never viewed is what is said",
        "blind; say place/1 category bedroom",
        place="bedroom",
    ),
    Script(
        "a place taken back goes on from its views",
        "view kitchen; say place/1 category bedroom; view kitchen; unsay place/1 category; "
        "view attic",
        place="kitchen",
    ),
    Script(
        "perception comes to agree about a place",
        "view kitchen; say place/1 category attic; view attic; view attic",
        place="attic",
    ),
    Script(
        "a belief edited by hand is what the next view goes on from",
        "view kitchen; view kitchen; view kitchen; rethink kitchen 0.2 1; view attic",
        place="attic",
    ),
    # all at once
    Script(
        "corrected and put elsewhere, it is known by both names at both spots",
        "see cup; say object/1 category bowl; say object/1 position 4 2 0; see bowl; see cup",
        "1 bowl 4 2",
        conflicts="object/1 category, object/1 position",
    ),
    Script(
        "one is deleted while another is corrected",
        "see cup left; see cup right; say object/2 category bowl; delete object/1; see cup left",
        "2 bowl 2 -1.04, 3 cup 2 1.04",
        conflicts="object/2 category",
    ),
)
