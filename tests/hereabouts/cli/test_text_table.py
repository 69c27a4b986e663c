"""Text tables fit into the terminal, and show every character of every cell once."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hereabouts.cli import main
from hereabouts.cli.console import note, text_table


def test_numbers_are_set_to_the_right_under_a_ruled_header() -> None:
    table = text_table(("object", "x"), [("cup 1", "1.25"), ("chair 10", "10.00")], [0, 1], 200)
    assert table.splitlines() == [
        " object         x",
        " ────────────────",
        " cup 1       1.25",
        " chair 10   10.00",
    ]


def test_long_cells_are_folded_between_words() -> None:
    table = text_table(("what", "why"), [("cup", "it was seen on the table")], [0, 0], 20)
    assert table.splitlines() == [
        " what  why",
        " ───────────────────",
        " cup   it was seen",
        "       on the table",
    ]


def test_wide_and_combining_characters_are_counted_as_terminals_show_them() -> None:
    rows = [("湯呑み", "a"), ("Bücher", "b"), ("cup", "c")]
    ends = [line[-1] for line in text_table(("label", ""), rows, [0, 0], 80).splitlines()[2:]]
    assert ends == ["a", "b", "c"]
    assert text_table(("label", ""), rows, [0, 0], 80).splitlines()[2] == " 湯呑み  a"
    assert text_table(("label", ""), rows, [0, 0], 80).splitlines()[3] == " Bücher  b"


def test_characters_that_control_a_terminal_are_left_out() -> None:
    table = text_table(("label",), [("\x1b[31mred\x07\x9b2J",)], [0], 80)
    assert table.splitlines()[2] == " [31mred2J"


cells = st.text(st.characters(codec="ascii", categories=("L", "N", "P")), max_size=30)


@given(st.lists(st.tuples(cells, cells, cells), max_size=5), st.integers(20, 130))
def test_every_table_fits_and_shows_all(rows: list[tuple[str, str, str]], width: int) -> None:
    table = text_table(("one", "two", "three"), rows, [0, 1, 0], width)
    assert max(map(len, table.splitlines())) <= width
    shown = sorted(table.replace(" ", "").replace("─", "").replace("\n", ""))
    assert shown == sorted("onetwothree" + "".join("".join(row) for row in rows))


def test_errors_and_notes_do_not_control_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "no\x1b[2Jfolder\u202e"]) == 1
    note("of a file: \x1b]0;title\x07")
    shown = capsys.readouterr().err
    assert "no[2Jfolder" in shown and shown.replace("\n", "").isprintable()
