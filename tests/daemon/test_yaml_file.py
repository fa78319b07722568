"""YAML that is no settings file: bounds and odd values."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from cellwatt.yaml_file import DEEPEST, parse_yaml

BOMB = "a: &a [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


REFUSED = (
    "when: 2001-13-01",
    "a: !!bool 5",
    "a: !!int x",
    "a: !!timestamp x",
    "? [1]\n: 2",
    "a: !!python/object:os.system x",
    "[" * 400_000,
    "- " * 50_000 + "x",
    "a: &a [*a]",
    BOMB,
    "a: *b",
    "a: [",
    "a\0b",
    "--- a\n--- b",
)


def test_what_is_refused_in_one_line():
    for text in REFUSED:
        with pytest.raises(ValueError, match=r".") as error:
            parse_yaml(text)
        assert len(str(error.value).splitlines()) == 1
        assert len(str(error.value)) < 400


def test_all_else_is_read_as_ever():
    reference = (Path(__file__).parents[2] / "examples" / "demo-reference.yaml").read_text()
    for text in ("", "a: &a [1, 2]\nb: *a\nc: {<<: {d: 1.5}}", "a: 2001-01-02\nb: [null, yes, 0x1f]", reference):
        assert parse_yaml(text) == yaml.safe_load(text)
    assert parse_yaml("[" * DEEPEST + "]" * DEEPEST)
