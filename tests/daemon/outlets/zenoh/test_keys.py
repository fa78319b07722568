from __future__ import annotations

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt import ConfigError, ProtocolError
from cellwatt.outlets.zenoh.keys import (
    Address,
    CellKeys,
    alarm_path,
    escape,
    parse,
    raw_topic,
    series_of_topic,
    topic_of_series,
)

NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
KEYS = CellKeys("plant-1", "weld-3")


@settings(deadline=None)
@given(NAMES)
def test_any_name_is_one_chunk_that_zenoh_takes_as_it_is(name: str) -> None:
    chunk = escape(name)
    assert "/" not in chunk
    key = f"cellwatt/{chunk}/x"
    assert str(zenoh.KeyExpr(key)) == key
    # No escaped name may act as a wildcard or hide from one.
    assert zenoh.KeyExpr(key).intersects("cellwatt/*/x")
    assert not zenoh.KeyExpr(key).intersects("cellwatt/other/x") or name == "other"


@settings(deadline=None)
@given(NAMES, NAMES, NAMES, NAMES)
def test_parse_gives_back_what_the_key_was_made_of(site: str, cell: str, source: str, stream: str) -> None:
    keys, topic = CellKeys(site, cell), raw_topic(source, stream)
    assert parse(keys.live(topic)) == Address(site, cell, "raw", (source, stream))
    assert parse(keys.live(topic)).topic == topic


def test_topic_of_an_alarm_is_without_severity_and_kind() -> None:
    address = parse(KEYS.live(alarm_path("error", "joint_fault", "a 1")))
    assert address.names == ("error", "joint_fault", "a 1")
    assert address.topic == "alarm"
    assert alarm_path("error", "joint_fault", "a/1") == "alarm/error/joint_fault/a%2F1", "escaped as in URLs"


@pytest.mark.parametrize(
    "key",
    ["", "cellwatt/a/b/@/status", "cellwatt/a/b/raw/arm", "cellwatt/a/b/alarm/error", "other/a/b/frame"],
)
def test_foreign_keys_are_refused(key: str) -> None:
    with pytest.raises(ProtocolError, match="not a key of a cellwatt cell"):
        parse(key)


def test_an_empty_name_is_refused_at_once() -> None:
    with pytest.raises(ConfigError, match="empty name"):
        CellKeys("plant", "")


@pytest.mark.parametrize("series", ["event", "prediction/power", "prediction/a/b %20#"])
def test_a_series_is_known_by_its_topic(series: str) -> None:
    topic = topic_of_series(series)
    assert parse(KEYS.live(topic)).kind == series.partition("/")[0]
    assert series_of_topic(topic) == series
