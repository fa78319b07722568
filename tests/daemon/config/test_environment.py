from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.config.environment import expand

ENVIRON = {"A": "one", "B_2": "two", "EMPTY": ""}


@pytest.mark.parametrize(
    ("text", "value", "shown"),
    [
        ("plain", "plain", "plain"),
        ("${A}", "one", "${A}"),
        ("x${A}y${B_2}z", "xoneytwoz", "x${A}y${B_2}z"),
        ("${A:-d}", "one", "${A}"),
        ("${NO:-d}", "d", "${NO}"),
        ("${EMPTY:-d}", "d", "${EMPTY}"),
        ("${EMPTY}", "", "${EMPTY}"),
        ("${NO:-}", "", "${NO}"),
        ("${NO:-a:-b}", "a:-b", "${NO}"),
        ("$${A}", "${A}", "${A}"),
        ("$A costs $5 or $$", "$A costs $5 or $$", "$A costs $5 or $$"),
    ],
)
def test_expand(text, value, shown):
    found = expand(text, ENVIRON)
    assert (found.value, found.shown, found.mistakes) == (value, shown, ())


def test_what_was_filled_in_is_known_by_its_name():
    assert expand("tls/${A}:${B_2}", ENVIRON).filled == {"one": "${A}", "two": "${B_2}"}
    assert expand("$${A} and $A", ENVIRON).filled == {}


@pytest.mark.parametrize("text", ["${", "a${A", "${}", "${1}", "${A-b}", "${ A }", "${NO}", "${A}${NO}"])
def test_mistakes(text):
    assert len(expand(text, ENVIRON).mistakes) == 1


def test_a_value_is_not_expanded_again():
    assert expand("${X}", {"X": "${A}"}).value == "${A}"


@given(st.text(alphabet="${}:-AB a", max_size=20))
def test_any_text(text):
    found = expand(text, {"A": "SECRET"})
    assert "SECRET" not in found.shown
    if "${" not in text:
        assert found.value == text
