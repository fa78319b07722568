"""Which power meter is needed: what each tells of faults, of what a simulation lacks, and of energy.

    python bench/meters.py              # writes docs/pictures/meters.svg and prints the table of docs/meters.md
    python bench/meters.py --json [--cells 3 --cycles 40 --windows 0.02 0.1 …]

Emulated arms of the benchmarks and tests: power as it is, and what a meter of one mean a window, that comes one and a
half windows late, makes of it. Some twenty minutes of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from faults.cases import make_case  # noqa: E402
from faults.scoring import Count, count  # noqa: E402
from real.browser import drawn  # noqa: E402
from tests.plugins.explain import plant  # noqa: E402
from tests.plugins.models.power.cases import model_of  # noqa: E402
from tests.plugins.models.power.emulated_arm import write_case  # noqa: E402
from tests.plugins.robot.slow_meter import shown  # noqa: E402

from cellwatt_plugins.explain.explain import explain  # noqa: E402
from cellwatt_plugins.explain.input.admission import admit  # noqa: E402
from cellwatt_plugins.faults.cycles.findings import judge_recording  # noqa: E402
from cellwatt_plugins.faults.cycles.known import learn_known  # noqa: E402
from cellwatt_plugins.faults.cycles.recording import Recording  # noqa: E402
from cellwatt_plugins.models.power.moves import read_moves  # noqa: E402
from cellwatt_plugins.models.power.scores import Score  # noqa: E402
from cellwatt_plugins.models.power.training import estimate  # noqa: E402
from cellwatt_plugins.robot import Arm  # noqa: E402

Float = NDArray[np.float64]

WINDOWS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""s; 0 is power at the rate of the encoders."""
LATE = 1.5
"""Windows by which a value comes after its own has ended."""
FIRST_CELL = 70
PICTURE = ROOT / "docs" / "pictures" / "meters.svg"
SUPPLY: dict[str, Callable[[Float, Float, Float], Float]] = {
    "converter_efficiency": lambda t, power, qd: plant.REAL.standby + (power - plant.REAL.standby) / 0.86,
    "iron_loss": lambda t, power, qd: power + 12 * np.sum(np.abs(qd) ** 1.5, axis=1),
    "brake_power": lambda t, power, qd: power + 9.0 * np.any(np.abs(qd) > 0.01, axis=1),
    "fan_switching": lambda t, power, qd: power + 15.0 * (t % 8 > 5),
}
"""What the supply has and the simulation lacks."""


@dataclass(frozen=True)
class Figures:
    """Of one meter."""

    window: float
    clear_faults: int
    isolated: int
    wrong_names: int
    calm_cycles: int
    false_alarms: int
    effects_named: tuple[str, ...]
    effects_wrong: int
    power_rmse: float
    """W, on moves that the model has not seen, against power as it is."""
    energy_mean: float
    energy_worst: float
    """%, a move."""


def main() -> None:
    """See the module."""
    parse = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parse.add_argument("--json", action="store_true")
    parse.add_argument("--cells", type=int, default=3)
    parse.add_argument("--cycles", type=int, default=40)
    parse.add_argument("--windows", type=float, nargs="+", default=WINDOWS)
    given = parse.parse_args()
    with threadpool_limits(1):
        every = [figures(window, given.cells, given.cycles) for window in given.windows]
    if given.json:
        print(json.dumps([asdict(one) for one in every]))
        return
    PICTURE.write_text(drawn({"meters": picture(every)})["meters"])
    print(table(every))


def metered(time: Float, power: Float, window: float, phase: float = 0.4) -> Float:
    """Power (N,) W as such a meter shows it."""
    return power if window == 0 else shown(time, power, window, LATE * window, phase=phase)


def figures(window: float, cells: int, cycles: int) -> Figures:
    """Everything that one meter tells."""
    found = sum((faults(seed, window, cycles) for seed in range(FIRST_CELL, FIRST_CELL + cells)), Count())
    named, wrong = effects(window)
    score = energy(window)
    assert score.power is not None and score.energy_mean is not None and score.energy_worst is not None
    return Figures(
        window,
        found.clear_faults,
        found.isolated,
        found.wrong_names,
        found.calm_cycles,
        found.false_alarms,
        named,
        wrong,
        score.power,
        score.energy_mean,
        score.energy_worst,
    )


def faults(seed: int, window: float, cycles: int) -> Count:
    """What is said of the cycles of one cell."""
    with tempfile.TemporaryDirectory() as folder:
        case = make_case(seed, Path(folder), cycles)
        healthy, judged = (
            Recording(time, q, metered(time, power, window)) for time, q, power in (case.healthy, case.judged)
        )
        known = learn_known(healthy, Arm.load(case.robot))
    return count(case.truths, judge_recording(judged, known), None)


def effects(window: float) -> tuple[tuple[str, ...], int]:
    """Effects of the supply that are named, and how many others are."""
    named, wrong = [], 0
    with tempfile.TemporaryDirectory() as folder:
        arm = plant.load(plant.write_robot(Path(folder)))
        for effect, added in SUPPLY.items():
            runs = [plant.record(f"run_0{n}", n, plant.Missing(drawn=added), seconds=60.0) for n in (1, 2)]
            runs = [replace(run, power=metered(run.time, run.power, window)) for run in runs if run.power is not None]
            found = {finding.effect for finding in explain(runs, admit(runs, arm)).findings.findings}
            named += [effect] if effect in found else []
            wrong += len(found - {effect})
    return tuple(named), wrong


def energy(window: float) -> Score:
    """Errors of a model on moves that it has not seen."""
    with tempfile.TemporaryDirectory() as folder:
        robot, table, unseen = write_case(Path(folder), "six axes", 11, moves=40, unseen=20)
        arm = Arm.load(robot)
        known, judged = read_moves([table], arm.description.names), read_moves([unseen], arm.description.names)
    power = known.power.copy()
    for number, (a, b) in enumerate(known.bounds()):
        power[a:b] = metered(known.time[a:b], power[a:b], window, number * 0.37 % 1)
    predicted, current = estimate(model_of(replace(known, power=power), arm), judged, arm)
    return Score.of(judged, predicted, current)


def table(every: Sequence[Figures]) -> str:
    """The figures as Markdown."""
    rows = [
        "| one mean every | faults isolated | false alarms | wrong names | effects of the supply named "
        "| energy of a move, mean and worst |",
        "|---|---|---|---|---|---|",
    ]
    for one in every:
        meter = "sample (100 Hz)" if one.window == 0 else f"{1e3 * one.window:.0f} ms"
        rows.append(
            f"| {meter} | {one.isolated} of {one.clear_faults} | {one.false_alarms} of {one.calm_cycles} cycles "
            f"| {one.wrong_names} | {len(one.effects_named)} of {len(SUPPLY)}, {one.effects_wrong} wrong "
            f"| {one.energy_mean:.2f} %, {one.energy_worst:.2f} % |"
        )
    return "\n".join(rows)


def picture(every: Sequence[Figures]) -> dict[str, object]:
    """Faults isolated and effects named, by the meter's window."""
    slow = [one for one in every if one.window > 0]
    x = [1e3 * one.window for one in slow]
    lines = {
        "faults isolated": [100 * one.isolated / one.clear_faults for one in slow],
        "effects of the supply named": [100 * len(one.effects_named) / len(SUPPLY) for one in slow],
    }
    return {
        "data": [{"x": x, "y": y, "name": name, "mode": "lines+markers"} for name, y in lines.items()],
        "layout": {
            "title": {"text": "What a power meter still tells"},
            "xaxis": {"title": {"text": "one mean every … ms"}, "type": "log", "tickvals": x},
            "yaxis": {"title": {"text": "%"}},
        },
    }


if __name__ == "__main__":
    main()
