"""ECDP: Table III by our equations, and campaigns on arms whose true energies are known."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt_plugins.energy.clock import Offset
from cellwatt_plugins.energy.drive import features
from cellwatt_plugins.energy.equations import electrical_losses, payload_efficiency
from cellwatt_plugins.energy.identify import Belief, Observed, begin, identify
from cellwatt_plugins.energy.recordings import PowerTrace, Recorded, RobotTrace
from cellwatt_plugins.energy.repetitions import Repetition
from cellwatt_plugins.robot import Arm

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT / ".." / "shared" / "energy_runs"
DATA = ROOT / ".." / "shared" / "data"
ONE = (Repetition(0.0, 1.0, 0.0),)
"""A move is one repetition, whose ends do not count here."""

ELECTRONICS = {"FR3": 65.21, "UR5e": 81.41, "UR10e": 78.56, "Gen3": 29.54}
"""P_E of Table II, W."""
TABLE_III = {
    "FR3": [
        (3719.7, 2518.9, 720.0, 476.4, 4.3, 4128.3, 2518.9, 720.0, 884.8, 4.5, 9.9),
        (1917.7, 1259.5, 360.0, 293.9, 4.3, 2126.0, 1259.5, 360.0, 501.9, 4.6, 9.8),
        (1326.9, 839.6, 240.0, 243.0, 4.2, 1465.5, 839.6, 240.0, 381.1, 4.7, 9.5),
        (1035.2, 629.7, 180.0, 221.1, 4.4, 1139.3, 629.7, 180.0, 324.9, 4.7, 9.1),
        (859.5, 503.8, 144.0, 207.4, 4.3, 947.3, 503.8, 144.0, 294.9, 4.6, 9.3),
    ],
    "UR5e": [
        (3542.8, 3145.6, 168.8, 234.9, -4.7, 3870.1, 3145.6, 168.8, 555.1, 2.3, 8.5),
        (1836.0, 1572.8, 84.4, 178.8, -0.1, 2002.3, 1572.9, 84.4, 338.2, 6.6, 8.3),
        (1281.9, 1048.6, 56.3, 173.9, 3.1, 1385.0, 1048.6, 56.3, 270.5, 9.7, 7.4),
        (998.0, 786.6, 42.2, 164.4, 4.2, 1084.1, 786.5, 42.2, 243.5, 11.9, 7.9),
        (838.5, 629.3, 33.8, 168.6, 6.7, 906.2, 629.3, 33.8, 230.2, 13.9, 7.5),
    ],
    "UR10e": [
        (7485.4, 6147.4, 534.6, 808.2, -4.6, 9494.4, 6147.3, 534.6, 2814.9, -2.4, 21.2),
        (3904.6, 3073.8, 267.3, 559.5, 4.1, 4932.3, 3073.8, 267.3, 1585.7, 5.5, 20.8),
        (2727.7, 2049.2, 178.2, 493.1, 6.7, 3438.8, 2049.3, 178.2, 1194.9, 16.4, 20.7),
        (2145.4, 1537.0, 133.7, 465.1, 9.4, 2693.4, 1537.0, 133.7, 1002.8, 19.9, 20.3),
        (1817.1, 1229.6, 106.9, 463.4, 17.4, 2255.6, 1229.6, 106.9, 897.9, 21.2, 19.5),
    ],
    "Gen3": [
        (1300.1, 1133.6, 0.0, 159.6, 6.9, 1642.7, 1133.7, 0.0, 503.0, 6.1, 20.9),
        (691.6, 568.7, 0.0, 115.3, 7.6, 871.2, 568.6, 0.0, 296.0, 6.5, 20.6),
        (494.3, 378.2, 0.0, 108.0, 8.1, 616.8, 378.7, 0.0, 231.4, 6.7, 19.9),
        (392.0, 288.1, 0.0, 95.5, 8.3, 485.8, 288.6, 0.0, 190.1, 7.1, 19.3),
    ],
}
"""J: E_R, E_E, E_MB, L_E*, L_M without payload, the same with it, and ε_P in percent; one row a speed."""
HALVES = (slice(0, 5), slice(5, 10))

RUNS = {robot: np.array([row[half] for half in HALVES for row in rows]) for robot, rows in TABLE_III.items()}
"""(2 R, 5) J: every run of a robot, without and with payload."""


@pytest.mark.parametrize("robot", list(TABLE_III))
def test_every_row_of_table_iii_by_our_equations(robot):
    for total, electronics, brakes, electrical, mechanical in RUNS[robot]:
        assert electrical_losses(total, electronics, brakes, mechanical) == pytest.approx(electrical, abs=2.0)
    for row in TABLE_III[robot]:
        assert payload_efficiency(row[5], row[0]) == pytest.approx(row[10], abs=0.06)


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_the_shared_campaigns_by_their_own_scorer(arm, tmp_path):
    if not SHARED.exists():
        pytest.skip("the shared campaigns are not beside the checkout")
    command = f"{sys.executable} -c 'from cellwatt.commands import main; main()'"
    words = ["--case", str(SHARED / arm), "--out", str(tmp_path), "--command", command]
    subprocess.run([sys.executable, str(SHARED / "score.py"), *words], check=True, capture_output=True)
    figures = json.loads((tmp_path / "score.json").read_text())
    worst = {name: value for name, value in figures.items() if name.endswith("worst_percent")}
    assert max(worst.values()) < 1.0
    assert max(abs(watt) for watt in figures["fixed_error_watt"].values()) < 0.2
    assert figures["negative_mechanical_losses"] == 0


BELIEF = Belief((45.0, 20.0), np.ones(6), np.full(6, 0.3), 0.5)
needs_ur3e = pytest.mark.skipif(
    not (DATA / "ur3e_power").is_dir(), reason="the recordings of the UR3e are not beside the checkout"
)


def fit(arm, moves):
    return identify(moves, begin(arm, BELIEF.fixed[0]), BELIEF)


def recorded_ur3e(folder):
    """Five short moves of a real UR3e (Hein Lab, MIT): power of the 48 V bus, torque from the joints' currents."""
    from models import ur3e

    described = ur3e.write_robot(folder)
    # Resistances are not published; a common factor is free.
    text = described.read_text().replace("torque_constant", "winding_resistance: 1.0\n  torque_constant")
    described.write_text(f"{text}torque_from: current\n")
    runs = []
    for path in ur3e.write_moves(DATA, folder):
        table = pq.read_table(path)
        time = table["t"].to_numpy()
        q, qd, current = (np.stack([table[f"{s}_{i}"] for i in range(1, 7)], axis=1) for s in ("q", "qd", "current"))
        motion = RobotTrace(path.name, time, q, qd, current * np.array(ur3e.CONSTANT))
        runs.append(Recorded(path.stem, 0.0, 0.0, motion, PowerTrace(path.name, time, table["power"].to_numpy())))
    arm = Arm.load(folder)
    feature = [features(arm, run.motion.torque, run.motion.velocity) for run in runs]
    return arm, [Observed(*each, Offset(0.0, 0.04), ONE) for each in zip(runs, feature, strict=True)]
