"""YAML that is no settings file: bounds and odd values."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from cellwatt.config import FrameSettings
from cellwatt.record.header import recorded_section
from cellwatt.yaml_file import DEEPEST, parse_yaml

BOMB = "a: &a [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


REFUSED = (
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


def test_all_else_is_read_as_the_settings_of_a_cell_are():
    reference = (Path(__file__).parents[2] / "examples" / "demo-reference.yaml").read_text()
    for text in ("", "a: &a [1, 2]\nb: *a\nc: {<<: {d: 1.5}}", "b: [null, true, 0x1f, -.inf, 1.0e-05]", reference):
        assert parse_yaml(text) == yaml.safe_load(text)
    text = "[2001-01-02, 2001-13-01, yes, on, 0123, 12:30, 1_000, 1e3, 0o17]"
    assert parse_yaml(text) == ["2001-01-02", "2001-13-01", "yes", "on", "0123", "12:30", "1_000", 1000.0, 15]
    assert parse_yaml("[" * DEEPEST + "]" * DEEPEST)


def test_the_settings_in_a_recording_are_read_as_the_daemon_read_them():
    settings = "site: plant\ncell: 1200-13-45\nframes: {rate: 20 Hz}\n"
    assert recorded_section(settings, "frames", FrameSettings).rate == 20.0
