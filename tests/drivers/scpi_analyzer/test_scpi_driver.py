from __future__ import annotations

import math

import numpy as np
import pytest

from cellwatt.channel import Quality
from cellwatt.emulation.relay import clients
from cellwatt.errors import ConnectError, DeviceError
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver
from cellwatt_drivers.scpi_analyzer.emulated_analyzer import AFTER_RESET, EmulatedAnalyzer
from tests.patience import eventually

from .rig import Inlet, emulated, running, settings

DEFAULT = ("URMS", "IRMS", "P", "S", "Q", "LAMB")
TRUTH = [230.0, 2.5, 500.0, 575.0, math.sqrt(575.0**2 - 500.0**2), 500.0 / 575.0]


HMC8015 = ("Rohde & Schwarz", "HMC8015", "SW1.403")


@pytest.mark.parametrize(
    ("address", "model", "identity"),
    [
        ("127.0.0.1:0", "hmc8015", HMC8015),
        ("pty", "hmc8015", HMC8015),
        ("127.0.0.1:0", "wt300", ("Yokogawa", "WT310E", "F1.03")),
        ("127.0.0.1:0", "lmg600", ("ZES Zimmer", "LMG670", "7.134")),
    ],
)
async def test_values_in_si_units(address, model, identity):
    async with emulated(address, model=model) as (_, place), running(settings(place, model=model)) as run:
        await eventually(lambda: len(run.inlet.readings) >= 3)
    for reading in run.inlet.readings:
        assert reading.values[0] == pytest.approx(TRUTH, rel=1e-4)
        assert reading.quality.tolist() == [Quality.GOOD]
    assert [(found.maker, found.model, found.firmware) for found in run.inlet.identities] == [identity]
    assert not run.failures


async def test_what_was_selected_before_is_put_back():
    async with emulated() as (emulator, place):
        async with running(settings(place)) as run:
            await eventually(lambda: len(run.inlet.readings) >= 2)
            assert emulator.analyzer.functions == DEFAULT
        await eventually(lambda: emulator.analyzer.functions == AFTER_RESET)


async def test_without_select_only_queries_leave():
    async with emulated() as (emulator, place):
        async with running(settings(place, select=False, error_check="1 ms")) as run:
            await eventually(lambda: len(run.inlet.readings) >= 3)
            await run.driver.identify()
        assert set(emulator.lines) == {"*IDN?", "SYST:ERR?", "CHAN1:MEAS:FUNC?", "CHAN1:MEAS:DATA?"}
    assert run.inlet.readings[0].values[0] == pytest.approx(TRUTH, rel=1e-4)


async def test_a_list_that_lacks_a_function_is_refused(monkeypatch):
    monkeypatch.setattr(EmulatedAnalyzer, "_select", lambda *_: None)  # as in local mode
    async with emulated() as (_, place):
        for select, why in ((False, "choose them there, or set select: true"), (True, "is it locked or in local mode")):
            driver = ScpiAnalyzerDriver("supply", settings(place, select=select, functions=["P", "WH"]), Inlet())
            with pytest.raises(DeviceError, match=f"lacks WH: .*{why}"):
                await driver.run()


async def test_a_list_that_another_client_changes_is_told_and_set_again():
    async with emulated() as (emulator, place), running(settings(place, error_check="1 ms")) as run:
        await eventually(lambda: len(run.inlet.readings) >= 2)
        emulator.analyzer.functions = DEFAULT[::-1]
        await eventually(lambda: emulator.analyzer.functions == DEFAULT)
    told = "the analyzer's list became LAMB, Q, S, P, IRMS, URMS: by whom was it changed?"
    assert told in run.inlet.texts("reopened")[0]


async def test_energy_counts_only_while_the_integrator_runs():
    async with emulated() as (emulator, place):
        async with running(settings(place, functions=["WH"])) as run:
            await eventually(lambda: len(run.inlet.readings) >= 4)
        assert not emulator.analyzer.running
        assert {float(r.values[0, 0]) for r in run.inlet.readings} == {0.0}
        async with running(settings(place, functions=["WH"], integrate=True)) as run:
            await eventually(lambda: len(run.inlet.readings) >= 12)
        assert emulator.analyzer.running
    joules = np.array([r.values[0, 0] for r in run.inlet.readings])
    assert np.all(np.diff(joules) >= 0)
    # 500 W in steps of 0.1 s are 50 J each.
    steps = np.diff(joules) / 50.0
    assert steps == pytest.approx(np.round(steps), abs=1e-2)
    assert steps.sum() >= 8


async def test_overload_is_flagged_counted_and_told_once():
    async with emulated() as (emulator, place), running(settings(place)) as run:
        await eventually(lambda: len(run.inlet.readings) >= 2)
        assert "overload" not in run.inlet.kinds()
        emulator.analyzer.overload = {"IRMS", "P"}
        await eventually(lambda: run.inlet.account.counters["overloads"] >= 3)
        reading = run.inlet.readings[-1]
        emulator.analyzer.overload = set()
        seen = len(run.inlet.readings)
        await eventually(lambda: len(run.inlet.readings) > seen + 1)
    assert reading.quality.tolist() == [Quality.CLIPPED]
    assert np.isnan(reading.values[0]).tolist() == [False, True, True, False, False, False]
    assert run.inlet.texts("overload") == ["supply: IRMS, P overloaded: the range is too small"]
    assert run.inlet.readings[-1].quality.tolist() == [Quality.GOOD]


async def test_polling_faster_than_the_analyzer_measures_counts_repeats():
    async with emulated() as (emulator, place), running(settings(place, rate="50 Hz")) as run:
        emulator.analyzer.measurements = 0
        await eventually(lambda: len(run.inlet.readings) >= 30)
    # The load stands still, so every answer but the first repeats; none of them is lost.
    assert run.inlet.account.counters["repeats"] == len(run.inlet.readings) - 1
    assert run.inlet.account.received == len(run.inlet.readings)
    assert emulator.analyzer.measurements < len(run.inlet.readings)


async def test_the_error_queue_is_read():
    async with emulated() as (emulator, place):
        emulator.analyzer.execute("NONSENSE", 0.0)
        async with running(settings(place, error_check="50 ms")) as run:
            await eventually(lambda: len(run.inlet.readings) >= 2)
            emulator.analyzer.execute("CHAN1:MEAS:FUNC NONSENSE", 0.0)
            await eventually(lambda: run.inlet.kinds().count("instrument_error") == 2)
    texts = run.inlet.texts("instrument_error")
    assert "from before this connection: -113 Undefined header" in texts[0]
    assert "while measuring: -224 Illegal parameter value" in texts[1]
    assert run.inlet.account.counters["instrument errors"] == 2


@pytest.mark.parametrize(
    ("said", "match", "counted"),
    [(b"", r"gave no answer within 0\.2 s$", {"timeouts": 1}), (b"x" * 20_000, "floods", {})],
)
async def test_a_port_that_never_answers_or_floods_is_told(said, match, counted):
    async def serve(reader, writer):
        await reader.readline()
        writer.write(said)
        await reader.read()

    async with clients(serve) as (place, _):
        driver = ScpiAnalyzerDriver("supply", settings(place, timeout="200 ms"), Inlet())
        with pytest.raises(ConnectError, match=match):
            await driver.run()
    assert driver.inlet.account.counters == counted
