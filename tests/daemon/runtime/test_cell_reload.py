"""A reload changes what changed and nothing else, and nothing at all where the new settings cannot be."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cellwatt import Batch, CellwattError
from cellwatt.config import FrameSettings
from cellwatt.record import Recording
from cellwatt.runtime.change import Change
from cellwatt.units import Units
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import (
    DEVICES,
    RECEIVERS,
    answer,
    config_of,
    give,
    look,
    outlets,
    running,
    sources,
)

TWO = config_of(sources=sources("arm", "board"), outlets=outlets("bus", "other"))


def numbers(source):
    """Sequence numbers of a source's samples, in order."""
    return [b.sequence for b in RECEIVERS["other"].of(Batch) if b.source == source]


@at_once
async def test_a_source_that_changed_goes_on_with_its_numbers_and_the_other_is_not_touched():
    for name in ("arm", "board"):
        DEVICES[name].tell(answer, give(3))
    async with running(TWO) as cell:
        for name in ("arm", "board"):
            await DEVICES[name].done()
        done = await cell.reload(replace(TWO, sources=sources("arm", "board", arm="new")))
        assert done == "reloaded: source arm"
        for name in ("arm", "board"):
            DEVICES[name].tell(answer, give(2))
            await DEVICES[name].done()
        assert numbers("arm") == numbers("board") == [0, 1, 2, 3, 4]
        assert (len(DEVICES["arm"].runs), DEVICES["arm"].most_open) == (2, 1), "one driver at a time"
        assert len(DEVICES["board"].runs) == 1
        assert len(RECEIVERS["bus"].runs) == 1
        status = await look(cell)
        assert status["sources"]["board"]["received"] == 5
        assert status["sources"]["arm"] | {"expected": 2, "received": 2, "residue": 0} == status["sources"]["arm"]
        assert "reloaded" in RECEIVERS["bus"].told


@at_once
async def test_a_source_that_was_removed_is_let_go_and_one_that_was_added_runs():
    DEVICES["arm"].tell(answer, give(3))
    async with running(TWO) as cell:
        await DEVICES["arm"].done()
        done = await cell.reload(replace(TWO, sources=sources("board", "meter")))
        assert done == "reloaded: source arm, source meter"
        DEVICES["meter"].tell(answer, give(3))
        await DEVICES["meter"].done()
        assert (DEVICES["arm"].open, DEVICES["board"].open, DEVICES["meter"].open) == (0, 1, 1)
        assert list((await look(cell))["sources"]) == ["board", "meter"]
        assert {c["name"] for c in cell.view.schema()["frame"]["channels"]} == {
            f"{s}.bus.{q}" for s in ("board", "meter") for q in ("voltage", "current")
        }


@at_once
async def test_an_outlet_that_changed_is_made_anew_and_the_data_go_on():
    config = config_of(outlets=outlets("bus", "other"))
    DEVICES["arm"].tell(answer, give(3))
    async with running(config) as cell:
        await DEVICES["arm"].done()
        frames = len(RECEIVERS["other"].frames)
        assert await cell.reload(replace(config, outlets=outlets("bus", "other", bus="new"))) == "reloaded: outlet bus"
        DEVICES["arm"].tell(give(3))
        await DEVICES["arm"].done()
        assert (len(RECEIVERS["bus"].runs), RECEIVERS["bus"].most_open) == (2, 1)
        assert len(RECEIVERS["other"].runs) == 1
        assert numbers("arm") == list(range(6))
        assert len(DEVICES["arm"].runs) == 1
        assert len(RECEIVERS["other"].frames) > frames


async def test_the_record_goes_on_in_a_new_file_that_names_the_new_source(tmp_path):
    config = config_of(record=tmp_path)
    async with running(config) as cell:
        DEVICES["arm"].tell(answer, give(3))
        await DEVICES["arm"].done()
        await cell.reload(replace(config, sources=sources("arm", "board")))
        DEVICES["board"].tell(answer, give(3))
        await DEVICES["board"].done()
    files = sorted(tmp_path.glob("*.mcap"))
    assert [list(Recording.open(file).header.streams) for file in files] == [["arm"], ["arm", "board"]]


@pytest.mark.parametrize("change", [{"site": "other"}, {"cell": "other"}, {"latency": "low"}])
def test_what_needs_a_restart(change):
    (name,) = change
    with pytest.raises(CellwattError, match=f"{name} needs a restart; nothing was changed"):
        Change.between(TWO, replace(TWO, sources=sources("board"), **change))
    assert str(Change.between(TWO, replace(TWO, text="# another comment"))) == "nothing changed"
    assert str(Change.between(TWO, replace(TWO, frames=FrameSettings(rate=25.0)))) == "reloaded: frames"
    units = Change.between(TWO, replace(TWO, units=Units(energy="kWh")))
    assert units and str(units) == "reloaded: units"
