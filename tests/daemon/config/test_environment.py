from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from cellwatt.config.environment import expand

ENVIRON = {"A": "one", "B_2": "two", "EMPTY": ""}


def test_what_was_filled_in_is_known_by_its_name():
    assert expand("tls/${A}:${B_2}", ENVIRON).filled == {"one": "${A}", "two": "${B_2}"}
    assert expand("$${A} and $A", ENVIRON).filled == {}


def test_mistakes():
    for text in ("${", "${}", "${A-b}", "${ A }", "${A}${NO}"):
        assert len(expand(text, ENVIRON).mistakes) == 1, text


def test_a_value_is_not_expanded_again():
    assert expand("${X}", {"X": "${A}"}).value == "${A}"


@given(st.text(alphabet="${}:-AB a", max_size=20))
def test_any_text(text):
    found = expand(text, {"A": "SECRET"})
    assert "SECRET" not in found.shown
    if "${" not in text:
        assert found.value == text
