"""Alarms of inputs that leave the training range: raised at once, cleared with hysteresis. Range −4 to 4, 50 Hz."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.plugins.models.making import CHANNELS, COLUMNS, START, Mlp, alarms, frames, layout, metadata, run, stage

SECOND = 50


@pytest.fixture
def path(tmp_path):
    return Mlp.random(4).save(tmp_path / "m.onnx", metadata())


def voltage(*spans: tuple[float, int]) -> np.ndarray:
    """Frames at rest but for the voltage, which has each value for so many frames."""
    values = np.zeros((sum(n for _, n in spans), len(CHANNELS)))
    values[:, COLUMNS[0]] = np.concatenate([np.full(n, v) for v, n in spans])
    return values


def at(frame: int) -> int:
    return START + frame * layout().step


def test_raised_once_with_channel_value_and_range(path):
    (alarm,) = alarms(run(stage(path), [frames(voltage((0, 10), (4.5, 30)))]))
    assert (alarm.kind, alarm.severity, alarm.active) == ("model_outside_range", "info", True)
    assert alarm.id == "power.meter.supply.voltage.model_outside_range"
    assert (alarm.source, alarm.since, alarm.time) == ("meter", at(10), at(10))
    assert alarm.statement == (
        "meter.supply.voltage is 4.5 V, outside the -4 to 4 V that model test-power was trained on: "
        "its predictions are extrapolated."
    )
    figures = {"value_V": 4.5, "low_V": -4.0, "high_V": 4.0}
    assert alarm.evidence == {"model": "test-power", "channel": "meter.supply.voltage", **figures}


def test_cleared_after_a_second_within_the_range(path):
    spans = (4.5, 5), (-6.0, 1), (4.5, 1), (3.9, SECOND + 20)
    raised, cleared = alarms(run(stage(path), [frames(voltage(*spans))]))
    assert cleared.id == raised.id
    assert (cleared.active, cleared.since, cleared.time) == (False, at(0), at(7 + SECOND - 1))
    assert cleared.evidence["furthest_V"] == -6.0


@pytest.mark.parametrize("value", [4.3, np.nextafter(4, 5)], ids=["in the margin", "just outside"])
def test_between_range_and_margin_nothing_changes(path, value):
    assert alarms(run(stage(path), [frames(voltage((value, 3 * SECOND)))])) == []
    spans = (4.5, 1), (0, SECOND - 1), (value, 1), (0, SECOND - 1)
    assert len(alarms(run(stage(path), [frames(voltage(*spans))]))) == 1


def test_missing_values_neither_raise_nor_clear(path):
    assert alarms(run(stage(path), [frames(voltage((np.nan, 2 * SECOND)))])) == []
    spans = (4.5, 1), (0, SECOND - 1), (np.nan, 2 * SECOND), (0, 1)
    cleared = alarms(run(stage(path), [frames(voltage(*spans))]))[1:]
    assert [a.time for a in cleared] == [at(3 * SECOND)]


def test_the_noise_of_an_input_that_rested_in_the_training_is_no_alarm(tmp_path):
    """An encoder's noise leaves a range that is nothing but noise; a turned joint is told, and its return."""
    training = replace(metadata().training, range=((1.0, 1.00002), (-4.0, 4.0), (-4.0, 4.0)))
    path = Mlp.random(4).save(tmp_path / "m.onnx", metadata(training=training))
    noisy = voltage((1.0, 200)) + 1e-4 * np.random.default_rng(0).standard_normal((200, 1))
    assert alarms(run(stage(path), [frames(noisy)])) == []
    noisy[20:60, COLUMNS[0]] += 0.01
    raised, cleared = alarms(run(stage(path), [frames(noisy)]))
    assert (raised.active, raised.time) == (True, at(20))
    assert (cleared.active, cleared.time) == (False, at(60 + SECOND - 1))
