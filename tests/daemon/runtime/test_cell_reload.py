"""A reload changes what changed and nothing else, and nothing at all where the new settings cannot be."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from cellwatt import Batch, CellwattError, ConfigError, Frames
from cellwatt.config import FrameSettings
from cellwatt.record import Recording
from cellwatt.record.settings import RecordSettings
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import (
    DEVICES,
    JUDGES,
    RECEIVERS,
    STEP,
    answer,
    config_of,
    fail,
    give,
    look,
    outlets,
    running,
    sources,
    stages,
    until,
)

TWO = config_of(sources=sources("arm", "board"), outlets=outlets("bus", "other"))


def numbers(source):
    """Sequence numbers of a source's samples, in order."""
    return [b.sequence for b in RECEIVERS["other"].of(Batch) if b.source == source]


@at_once
async def test_nothing_changed():
    DEVICES["arm"].tell(answer)
    async with running(TWO) as cell:
        await DEVICES["arm"].done()
        assert await cell.reload(replace(TWO, text="# another comment")) == "nothing changed"
        assert (len(DEVICES["arm"].runs), len(RECEIVERS["bus"].runs)) == (1, 1)
        assert RECEIVERS["bus"].told == ["connected"]


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
async def test_a_source_that_was_away_runs_with_its_new_address_at_once():
    DEVICES["arm"].tell(*[fail(CellwattError("unreachable"))] * 10)
    async with running(TWO) as cell:
        await until(lambda: len(DEVICES["arm"].runs) == 3)
        moved = dict(TWO.sources)
        moved["arm"] = replace(moved["arm"], settings=sources("elsewhere")["elsewhere"].settings)
        DEVICES["elsewhere"].tell(answer, give(1))
        await cell.reload(replace(TWO, sources=moved))
        await DEVICES["elsewhere"].done()
        assert (await look(cell))["sources"]["arm"]["state"] == "ok"


@at_once
async def test_a_outlet_that_changed_is_made_anew_and_the_data_go_on():
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


@at_once
async def test_a_outlet_that_was_removed_gets_nothing_more():
    async with running(TWO) as cell:
        await cell.reload(replace(TWO, outlets=outlets("other")))
        DEVICES["arm"].tell(answer, give(3))
        await DEVICES["arm"].done()
        assert (RECEIVERS["bus"].open, RECEIVERS["bus"].values) == (0, [])
        assert list((await look(cell))["sinks"]) == ["other"]


async def test_a_stage_that_changed_is_made_anew_after_what_was_queued():
    config = config_of(stages=stages("judge"))
    async with running(config) as cell:
        judge = JUDGES["judge"]
        judge.gate.clear()
        DEVICES["arm"].tell(answer, give(10))
        await DEVICES["arm"].done()
        await until(judge.inside.is_set)
        reloading = asyncio.create_task(cell.reload(replace(config, stages=stages("judge", judge="new"))))
        await asyncio.sleep(0)
        judge.gate.set()
        assert await reloading == "reloaded: stage judge"
        assert judge.seen == RECEIVERS["bus"].frames, "the old one has seen all frames so far"
        DEVICES["arm"].tell(give(10))
        await DEVICES["arm"].done()
        await until(lambda: judge.seen == RECEIVERS["bus"].frames)
        assert judge.seen == list(range(len(judge.seen)))
        assert len(DEVICES["arm"].runs) == 1


async def test_what_sources_give_while_stages_end_is_in_the_frames():
    config = config_of(sources=sources("arm", "board"), stages=stages("judge"))
    async with running(config) as cell:
        judge = JUDGES["judge"]
        judge.gate.clear()
        DEVICES["board"].tell(answer, give(1))
        DEVICES["arm"].tell(answer, give(20))
        await DEVICES["arm"].done()
        await until(judge.inside.is_set)
        reloading = asyncio.create_task(cell.reload(replace(config, stages=stages("judge", judge="new"))))
        await until(lambda: len(RECEIVERS["bus"].frames) >= 19)
        DEVICES["arm"].tell(give(3))
        await DEVICES["arm"].done()
        judge.gate.set()
        await reloading
        frames = RECEIVERS["bus"].of(Frames)
        column = frames[0].layout.index("arm.bus.voltage")
        volts = np.concatenate([f.values[:, column] for f in frames])
        assert np.nanmax(volts) > 21, "frames up to the 23rd sample, 22 V"
        assert set(np.diff(np.concatenate([f.time for f in frames]))) == {STEP}


@at_once
async def test_other_frames():
    DEVICES["arm"].tell(answer, give(10))
    config = config_of()
    async with running(config) as cell:
        await DEVICES["arm"].done()
        done = await cell.reload(replace(config, frames=FrameSettings(rate=25.0)))
        assert done == "reloaded: frames"
        DEVICES["arm"].tell(give(10))
        await DEVICES["arm"].done()
        assert cell.view.schema()["frame"]["rate_hz"] == 25.0
        assert RECEIVERS["bus"].frames == list(range(len(RECEIVERS["bus"].frames))), "their numbers go on"
        assert len(DEVICES["arm"].runs) == 1


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


# what cannot be ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"site": "other"}, "site needs a restart"),
        ({"cell": "other"}, "cell needs a restart"),
        ({"record": RecordSettings(folder="/recordings")}, "record needs a restart"),
    ],
)
@at_once
async def test_what_needs_a_restart(change, words):
    async with running(TWO) as cell:
        wanted = replace(TWO, sources=sources("board"), **change)
        with pytest.raises(CellwattError, match=f"{words}; nothing was changed"):
            await cell.reload(wanted)
        assert list((await look(cell))["sources"]) == ["arm", "board"]


async def test_a_stage_that_cannot_be_made_changes_nothing():
    config = config_of(stages=stages("judge"))
    async with running(config) as cell:
        DEVICES["arm"].tell(answer, give(5))
        await DEVICES["arm"].done()
        JUDGES["new"].refuse = ConfigError("the model is of another robot")
        with pytest.raises(ConfigError, match=r"stages\.new: the model is of another robot"):
            await cell.reload(replace(config, sources=sources("board"), stages=stages("judge", "new")))
        DEVICES["arm"].tell(give(5))
        await DEVICES["arm"].done()
        assert len(DEVICES["arm"].runs) == 1
        assert RECEIVERS["bus"].values == list(range(10))
        await until(lambda: JUDGES["judge"].seen == RECEIVERS["bus"].frames and len(JUDGES["judge"].seen) >= 9)
        assert not DEVICES["board"].runs


@at_once
async def test_a_reload_during_a_reload_waits_for_it():
    async with running(TWO) as cell:
        await until(lambda: DEVICES["arm"].open)
        notes = [replace(TWO, sources=sources("arm", "board", arm=note)) for note in ("one", "two", "three")]
        await asyncio.gather(*(cell.reload(config) for config in notes))
        await until(lambda: DEVICES["arm"].open)
        assert (DEVICES["arm"].open, DEVICES["arm"].most_open) == (1, 1)
        assert cell.view.config()["sources"]["arm"]["note"] == "three"
    assert DEVICES["arm"].open == 0


@at_once
async def test_a_stop_during_a_reload_ends_what_it_started():
    async with running(TWO) as cell:
        await until(lambda: DEVICES["arm"].open)
        reloading = asyncio.create_task(cell.reload(replace(TWO, sources=sources("arm", "board", arm="new"))))
        await asyncio.sleep(0)
        cell.stop()
    await reloading
    assert (DEVICES["arm"].open, DEVICES["arm"].most_open) == (0, 1)


@at_once
async def test_no_reload_of_a_cell_that_stops():
    async with running(TWO) as cell:
        cell.stop()
        with pytest.raises(CellwattError, match="is being stopped; nothing was changed"):
            await cell.reload(config_of())
