"""Analyzers of other makes: the same driver, another table."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cellwatt.channel import Quality
from cellwatt.errors import ProtocolError, WrongDeviceError
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver
from cellwatt_drivers.scpi_analyzer.dialect import WT300
from cellwatt_drivers.scpi_analyzer.emulated_makes import EmulatedLmg670, EmulatedWt310
from cellwatt_drivers.scpi_analyzer.wire import parse_count
from tests.patience import eventually

from .rig import STILL, Inlet, emulated, running, settings

OTHERS = ["wt300", "lmg600"]


@pytest.mark.parametrize(
    ("told", "item"),
    [
        ("U,1", "U,1"),
        (":NUMERIC:NORMAL:ITEM6 LAMBDA,1", "LAMB,1"),
        ("lambda,sigma", "LAMB,SIGMA"),
        ("P,SIGM", "P,SIGMA"),
        ("NONE", "NONE"),
    ],
)
def test_items_as_a_wt310_may_tell_them(told, item):
    assert WT300.found(told) == item


@pytest.mark.parametrize("line", ["", "256", "²"])
def test_what_is_no_count(line):
    with pytest.raises(ProtocolError, match="not a number of values"):
        parse_count(line)


async def test_what_a_wt310_answered_before_is_put_back():
    async with emulated(model="wt300") as (emulator, place):
        meter = emulator.analyzer
        assert isinstance(meter, EmulatedWt310)
        for line in (":NUM:NORM:ITEM1 FU,1", ":NUM:NORM:ITEM2 WH", ":NUM:NORM:NUM 2"):
            meter.execute(line, 0.0)
        async with running(settings(place, model="wt300", functions=["P", "URMS", "IRMS"])) as run:
            await eventually(lambda: len(run.inlet.readings) >= 2)
            assert (meter.number, meter.items[:3]) == (3, ["P,1", "U,1", "I,1"])
        await eventually(lambda: (meter.number, meter.items[:2]) == (2, ["FU,1", "WH,1"]))
        assert not meter.errors


@pytest.mark.parametrize("model", OTHERS)
async def test_everything_sent_is_on_the_list(model):
    told = " ".join(ScpiAnalyzerDriver.writes).replace("<functions>", "P1?;PF1?")
    wanted = {"error_check": "1 ms", "functions": ["WH", "P"] if model == "wt300" else ["P", "LAMB"]}
    async with emulated(model=model) as (emulator, place):
        async with running(settings(place, model=model, integrate=model == "wt300", **wanted)) as run:
            await eventually(lambda: len(run.inlet.readings) >= 2)
        sent = [_as_listed(line) for line in emulator.lines]
    assert len(sent) >= 5
    assert all(line in told for line in sent), sent


def _as_listed(line: str) -> str:
    """A line with numbers and functions as the list writes them."""
    line = re.sub(r"ITEM[0-9]+ [A-Z]+,1", "ITEM<n> <function>,<element>", line)
    return re.sub(r"(ITEM|NUM )[0-9]+", r"\1<n>", line)


@pytest.mark.parametrize("model", OTHERS)
async def test_overload_and_the_error_queue(model):
    async with (
        emulated(model=model) as (emulator, place),
        running(settings(place, model=model, error_check="50 ms")) as run,
    ):
        await eventually(lambda: len(run.inlet.readings) >= 2)
        emulator.analyzer.overload = {"IRMS"}
        emulator.analyzer.execute("NONSENSE", 0.0)
        await eventually(
            lambda: run.inlet.account.counters["overloads"] >= 2 and "instrument_error" in run.inlet.kinds()
        )
    last = run.inlet.readings[-1]
    assert last.quality.tolist() == [Quality.CLIPPED]
    assert np.isnan(last.values[0]).tolist() == [False, True, False, False, False, False]
    assert any("-113 Undefined header" in text for text in run.inlet.texts())


@pytest.mark.parametrize(
    ("wanted", "there", "said"),
    [
        ("hmc8015", {"idn": "YOKOGAWA,WT310,C2PL11001V,F1.03"}, "is not an HMC8015: it answers 'YOKOGAWA,WT310"),
        ("wt300", {"model": "lmg600"}, "is not a WT300: it answers 'ZES"),
        ("lmg600", {"model": "hmc8015"}, "is not an LMG600: it answers 'Rohde"),
    ],
)
async def test_another_make_is_the_wrong_device(wanted, there, said):
    async with emulated(**there) as (emulator, place):
        driver = ScpiAnalyzerDriver("supply", settings(place, model=wanted, timeout="200 ms"), Inlet())
        for attempt in (driver.run, driver.identify):
            with pytest.raises(WrongDeviceError, match=said):
                await attempt()
        assert set(emulator.lines) == {"*IDN?"}


def test_an_lmg670_understands_the_language_it_is_told():
    meter = EmulatedLmg670(STILL, "ZES,LMG670,1,1")
    assert meter.execute("INIM;P1?", 1.0) is None
    meter.execute("*ZLANG SHORT", 1.0)
    assert meter.execute("INIM;UTRMS1?;P1?", 1.0) == "2.300000E+02;5.000000E+02"
    assert meter.execute("SYST:ERR?", 1.0) is None
    meter.execute("*ZLANG SCPI", 1.0)
    assert meter.execute("SYST:ERR?", 1.0) == '-113,"Undefined header"'
