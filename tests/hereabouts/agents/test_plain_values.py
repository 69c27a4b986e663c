"""Text of strangers comes out in one visible, bounded line."""

import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from hereabouts.agents.plain_values import escaped


@given(st.text(), st.integers(min_value=2, max_value=80))
def test_whatever_comes_is_one_visible_line_of_bounded_length(text: str, most: int) -> None:
    shown = escaped(text, most)
    assert len(shown) <= most
    assert not any(unicodedata.category(c) in ("Cc", "Cf", "Cs", "Co", "Zl", "Zp") for c in shown)
    assert escaped(shown, most) == shown


def test_what_hides_text_is_written_out() -> None:
    hidden = "".join(chr(0xE0000 + ord(c)) for c in "hi")  # tag characters, which nobody sees
    assert escaped(f"cup{hidden}", 80) == r"cup\U000e0068\U000e0069"
    assert escaped("cup\ufe0f", 80) == r"cup\ufe0f"
    assert escaped("Käse 🧀", 80) == "Käse 🧀"
    assert escaped("a" * 50, 10) == "aaaaaaaaa…"
