"""Makes ``robot.yaml`` and ``energy.json`` of the arm that ``cellwatt demo`` emulates.

    PYTHONPATH=bench python -m energy.demo daemon/cellwatt/demo

The emulated arm's own numbers stand for those of a campaign; tests/daemon/demo/test_energy.py holds them against it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import yaml

from cellwatt.emulation import ArmSignals
from cellwatt_plugins.energy.findings import Findings, Fixed, JointDrive, JointFriction, RunEnergy

ROBOT = "demo"
CONTROLLER = 35.0
"""W of the emulated arm's standby that its controller is said to take; the rest is its electronics."""
SURE = 1e-4
"""Variance of each parameter of the drive: they are known."""


def described(arm: ArmSignals) -> dict[str, object]:
    """The content of robot.yaml."""
    columns = {
        "torque_constant": arm.torque_constant,
        "winding_resistance": arm.resistance,
        "coulomb_friction": arm.coulomb,
        "viscous_friction": arm.viscous,
    }
    joints = [{"name": f"joint_{i + 1}", **{k: v[i] for k, v in columns.items()}} for i in range(len(arm.home))]
    return {"robot": ROBOT, "urdf": "arm.urdf", "standby_power": arm.standby, "joints": joints}


def found(arm: ArmSignals) -> Findings:
    """What a campaign on it would find."""
    time = np.arange(0, arm.period, 0.002)
    q, qd, qdd = arm.motion(time)
    torque, _ = arm.torque(time, q, qd, qdd)
    motion = torque * qd
    copper = np.asarray(arm.resistance) * (torque / np.asarray(arm.torque_constant)) ** 2
    friction = (np.asarray(arm.coulomb) * np.abs(qd) + np.asarray(arm.viscous) * qd**2).sum()
    joules = 0.002
    total = joules * float((arm.standby + (motion + copper).sum(axis=1)).sum())
    run = RunEnergy(
        run="the emulated arm itself",
        speed_mm_s=0.0,
        payload_kg=0.0,
        repetitions=1,
        seconds=arm.period,
        total=total,
        electronics=arm.standby * arm.period,
        brakes=0.0,
        mechanical_losses=joules * float(friction),
        electrical_losses_with_regeneration=joules * float(copper.sum()),
        electrical_losses=joules * float(copper.sum()),
        regeneration=0.0,
        regeneration_upper_bound=-joules * float(np.minimum(motion, 0.0).sum()),
        positive_mechanical=joules * float(np.maximum(motion, 0.0).sum()),
        motion_efficiency_percent=0.0,
        analyzer_offset_s=0.0,
        path_speed_mm_s=0.0,
        uncertainty={"analyzer_offset_s": 0.001},
    )
    names = [f"joint_{i + 1}" for i in range(len(arm.home))]
    return Findings(
        robot=ROBOT,
        fixed=Fixed(CONTROLLER, arm.standby - CONTROLLER, 0.0, 0.1, 0.2, 0.1, 0.0),
        runs=(run,),
        payload_efficiency_percent={},
        average_share_percent={},
        drives=tuple(JointDrive(n, 1.0, 0.01, r, 0.0, 0.0, 0.0) for n, r in zip(names, arm.resistance, strict=True)),
        friction=tuple(
            JointFriction(n, v, c, 0.0, 0.0) for n, v, c in zip(names, arm.viscous, arm.coulomb, strict=True)
        ),
        returned=1.0,
        returned_uncertainty=0.01,
        model_error_percent=1.0,
        covariance=tuple(map(tuple, (SURE * np.eye(2 + 5 * len(names))).tolist())),
    )


def main(folder: Path) -> None:
    """Write both files."""
    arm = ArmSignals()
    text = yaml.safe_dump(described(arm), sort_keys=False, default_flow_style=None, width=120)
    note = "# The arm of the demo, as it is emulated; bench/energy/demo.py writes it.\n"
    (folder / "robot.yaml").write_text(note + text)
    (folder / "energy.json").write_text(json.dumps(found(arm).as_json(), separators=(",", ":")).replace("],[", "],\n["))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
