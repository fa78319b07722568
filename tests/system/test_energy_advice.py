"""Advice of the live stage, followed by the emulated arm: what was promised is saved."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.results import Alarm, Energy
from cellwatt_plugins.energy import advice
from cellwatt_plugins.energy.known import load_known
from cellwatt_plugins.energy.task_energy import Stretch
from cellwatt_plugins.robot import Arm
from tests.system.running import Audience, free_port, running
from tests.system.test_energy_four_robots import BENCH, RATE, write_arm, write_supply

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(900)]

LEAD = 12.0
"""s of rest before the first cycle: the clocks settle."""
COUNT = 5
"""Cycles: advice comes with the third task."""
BRAKES = 2.0
"""s after a task until the brakes may be on: the stage's ``brake_time``."""
CYCLES = [(250.0, 20.0), (500.0, 16.0), (700.0, 16.0), (250.0, 120.0)]
"""mm/s, and s from one task to the next."""


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """An emulated UR5e and the folder of its campaign, with energy.json."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCH))
        from tests.science.test_energy_procedure import measured

        folder = tmp_path_factory.mktemp("campaign")
        plant, findings = measured("UR5e", folder)
        (folder / "energy.json").write_text(json.dumps(findings.as_json()))
        yield plant, folder


def followed(cycle, kind: str, setting, plant):
    """The same work as the advice has it."""
    if kind in ("slower", "faster"):
        usual = sum(plant.cube.seconds(cycle.speed))
        return replace(cycle, speed=cycle.speed * usual / setting["motion_s"])
    return replace(cycle, brakes_after=setting["after_s"])


@pytest.mark.parametrize(("speed", "seconds"), CYCLES)
def test_what_a_change_would_save_is_what_it_saves(measured, speed: float, seconds: float) -> None:
    """Each kind of advice, also one that is not worth telling, against the plant's own energy; 50 Hz frames."""
    from tests.plugins.energy.procedure.plant import STEP
    from tests.plugins.energy.procedure.production import Cycle, play

    plant, folder = measured
    arm = Arm.load(folder)
    known = load_known(folder / "energy.json", arm)
    base = Cycle(speed, seconds)
    rows, watts = play(plant, base)
    moving = len(plant.motion(speed)[0])
    task, rest = (stretch(rows[part], watts[part], STEP) for part in (slice(moving), slice(moving, None)))
    cycle = advice.Cycle(task, seconds - moving * STEP, rest)
    for said in (advice.speed_advice(arm, known, cycle), advice.brake_advice(arm, known, cycle, BRAKES)):
        assert said is not None
        then = play(plant, followed(base, said.kind, said.setting, plant))[1]
        saved = float(watts.sum() - then.sum()) * STEP
        assert abs(said.saving - saved) < 2 * said.uncertainty, (said, saved)


def stretch(rows: np.ndarray, watts: np.ndarray, step: float, every: int = 10) -> Stretch:
    """Every tenth sample, and the mean power of ten."""
    count = len(rows) // every
    position, velocity, torque = np.hsplit(rows[: count * every : every], 3)
    power = watts[: count * every].reshape(count, every).mean(axis=1)
    return Stretch(step * every, position, velocity, torque, power)


async def work(folder: Path, plant, cycle, campaign: Path) -> tuple[float, Audience]:
    """A daemon with its stages beside the emulated arm and analyzer; energy of a cycle, J, and what was heard."""
    from tests.plugins.energy.procedure.production import play

    arm, supply = write_tables(folder, plant, *play(plant, cycle))
    ur, scpi, epoch = free_port(), free_port(), time.time() + 3.0
    text = f"""
sources:
  arm: {{driver: ur, host: 127.0.0.1, port: {ur}, rate: 100 Hz}}
  supply: {{driver: scpi_analyzer, host: 127.0.0.1, port: {scpi}, functions: [URMS, P]}}
stages:
  segment: {{}}
  energy: {{robot: {campaign / "robot.yaml"}, balance: {campaign / "energy.json"}, brake_time: {BRAKES} s}}
"""
    clock = ("--epoch", repr(epoch), "--recording")
    end = epoch + LEAD + COUNT * cycle.seconds
    options = ("--option", "at_end=hold", "--option", "start=epoch")
    async with (
        EmulatorProcess("ur", "--listen", f"127.0.0.1:{ur}", *clock, str(arm), *options),
        EmulatorProcess("scpi_analyzer", "--listen", f"127.0.0.1:{scpi}", *clock, str(supply)),
        running(folder, text) as (daemon, audience),
    ):
        await audience.until(lambda a: newest(a) > end, LEAD + COUNT * cycle.seconds + 60)
        assert await daemon.stop() == 0
    return measured_energy(audience, epoch + LEAD, cycle.seconds), audience


def newest(audience: Audience) -> float:
    batches = audience.batches["raw/supply/measured"]
    return float(batches[-1].time[-1] * 1e-9) if batches else 0.0


def measured_energy(audience: Audience, begin: float, seconds: float) -> float:
    """J of a cycle, by the analyzer's values over all whole cycles but the first."""
    batches = audience.batches["raw/supply/measured"]
    column = batches[0].stream.names.index("supply.power")
    time = np.concatenate([batch.time for batch in batches]) * 1e-9
    power = np.concatenate([batch.values[:, column] for batch in batches])
    edges = np.linspace(begin + seconds, begin + (COUNT - 1) * seconds, round((COUNT - 2) * seconds * 10) + 1)
    return float(np.interp(edges, time, power).mean()) * seconds


def write_tables(folder: Path, plant, rows: np.ndarray, watts: np.ndarray) -> tuple[Path, Path]:
    folder.mkdir()
    rng = np.random.default_rng(3)
    every = round(500 / RATE)
    lead = round(LEAD * RATE)
    home, none = plant.way[0](0.0)[None], np.zeros((1, 6))
    torque = plant.torque(home, none, none, 0.0)
    still = np.repeat(np.hstack([home, none, torque * np.array(plant.made.gains)]), lead, axis=0)
    level = np.full(lead, plant.powers(torque, none)["supply"][0] + plant.made.fixed)
    rows, power = rows[::every], watts[: len(watts) // every * every].reshape(-1, every).mean(axis=1)
    rows = np.vstack([still, *[rows] * COUNT, still])
    power = np.concatenate([level, *[power] * COUNT, level])
    rows = rows + rng.normal(size=rows.shape) * np.repeat([2e-5, 1e-3, 0.02], 6)
    return write_arm(folder / "arm.parquet", rows, plant), write_supply(folder / "supply.parquet", power, rng)


def heard(audience: Audience) -> dict[str, Alarm]:
    prefix = "energy_advice_"
    return {a.kind.removeprefix(prefix): a for a in audience.alarms if a.kind.startswith(prefix)}


async def test_advice_of_a_running_daemon_followed_by_the_emulated_arm(measured, tmp_path: Path) -> None:
    from tests.plugins.energy.procedure.production import Cycle

    plant, campaign = measured
    base = Cycle(500.0, 16.0)
    before, audience = await work(tmp_path / "before", plant, base, campaign)
    split = [result for result in audience.results["energy"] if isinstance(result, Energy)]
    assert len(split) >= 3
    for energy in split:
        assert abs(energy.groups["unexplained"]) < 3 * energy.uncertainty
    told = heard(audience)
    assert set(told) == {"slower", "brakes"}
    for kind, alarm in told.items():
        cycle = followed(base, kind, alarm.evidence, plant)
        after, audience = await work(tmp_path / kind, plant, cycle, campaign)
        said, unsure = alarm.evidence["saving_J"], alarm.evidence["uncertainty_J"]
        print(f"{kind}: said {said:.1f} ± {unsure:.1f} J, saved {before - after:.1f} J of {before:.0f} J")
        assert abs(before - after - said) < 2 * unsure + 0.002 * before, alarm.statement
        assert kind not in heard(audience)
