"""The mean against numpy's; the same results however the frames are cut into blocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from demand_stage import DemandSettings, DemandStage
from demand_stage.mean import MovingMean

from cellwatt import Alarm, CellInfo, ConfigError, FrameChannel, Frames, Layout, Prediction, Result

RATE = 10.0
LAYOUT = Layout(
    (
        FrameChannel("mains.supply.power", "W", "continuous", "average"),
        FrameChannel("mains.supply.voltage", "V", "continuous", "linear"),
    ),
    RATE,
)
CELL = CellInfo("plant-1", "weld-3", None, Path())


def stage(**settings: object) -> DemandStage:
    given = {"limit": "1 kW", "window": "2 s"} | settings
    return DemandStage("demand", DemandSettings.model_validate(given), LAYOUT, CELL)


def run(power: np.ndarray, block: int, **settings: object) -> list[Result]:
    """Results of a stage that is given the power in blocks."""
    made = stage(**settings)
    found: list[Result] = []
    for start in range(0, len(power), block):
        part = power[start : start + block]
        time = (start + np.arange(len(part))) * LAYOUT.step
        values = np.column_stack([part, np.full(len(part), 230.0)])
        quality = np.zeros(values.shape, np.uint8)
        found += made.process(Frames(LAYOUT, start, time, values, quality, np.zeros(values.shape, np.int64)), ())
    return [*found, *made.close()]


def means(results: list[Result]) -> np.ndarray:
    return np.concatenate([r.outputs["demand"] for r in results if isinstance(r, Prediction)])


def alarms(results: list[Result]) -> list[Alarm]:
    return [r for r in results if isinstance(r, Alarm)]


def test_the_mean_is_numpys() -> None:
    values = np.random.default_rng(1).normal(size=50)
    values[[7, 8, 30]] = np.nan
    truth = [np.nanmean(values[i - 9 : i + 1]) for i in range(9, 50)]
    found = MovingMean(10).update(values)
    assert np.isnan(found[:9]).all()
    np.testing.assert_allclose(found[9:], truth, rtol=1e-12)


@pytest.mark.parametrize("block", [1, 3, 100])
def test_blocks_do_not_matter(block: int) -> None:
    power = 1000.0 + 400.0 * np.sin(np.arange(300) / 30.0)
    whole, cut = run(power, 300), run(power, block)
    assert [(a.active, a.time) for a in alarms(cut)] == [(a.active, a.time) for a in alarms(whole)]
    found = means(cut)
    np.testing.assert_allclose(found[np.isfinite(found)], means(whole)[19:], rtol=1e-9)


def test_an_alarm_is_raised_once_and_cleared_below_the_limit() -> None:
    power = np.concatenate([np.full(40, 500.0), np.full(40, 1500.0), np.full(40, 980.0), np.full(40, 500.0)])
    raised, cleared = alarms(run(power, 10))
    assert (raised.active, cleared.active) == (True, False)
    assert raised.id == cleared.id
    assert raised.since == cleared.since == raised.time
    # 500 and 1500 W are on average above 1000 W once more than half of the two seconds is high.
    assert raised.time == (40 + 10) * LAYOUT.step
    assert cleared.evidence["mean_w"] < 950.0
    assert raised.source == "mains"


def test_a_channel_that_is_no_power_is_refused() -> None:
    with pytest.raises(ConfigError, match="is in V"):
        stage(power="supply.voltage")
    with pytest.raises(ConfigError, match=r"no source has the channel 'supply\.energy'"):
        stage(power="supply.energy")
