"""One function an experiment: from the recordings to what `explain` says of them, beside what the owner knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt_plugins.robot import Body
from real import kr300, ur10e
from real.calibrate import calibrated_gains
from real.identify import Prepared, carried_mass, identify
from real.product import Explained, explain
from real.recording import Float, Recording

Figures = dict[str, Any]
NORMAL_95 = 1.96
CALIBRATED_DOUBT = 0.01
"""What is left of the doubt of the gains after the pair of known mass."""
PAYLOAD_CASES = (
    ("published", ur10e.LOAD),
    ("controller", ur10e.LOAD),
    ("calibrated", ur10e.OTHER_LOAD),
    ("published", ur10e.UNSEEN_NO_LOAD),
)
"""Gains, and the recording that is explained with them; the last carries nothing."""


def payload(data: Path, work: Path) -> Figures:
    """UR10e with 2.805 kg at its flange: what is found with the published, the controller's and calibrated gains."""
    body = ur10e.body(data)
    unloaded = [ur10e.read(data, name) for name in ur10e.NO_LOAD]
    loaded = ur10e.read(data, ur10e.LOAD)
    gains = {
        "published": ur10e.PUBLISHED_GAINS,
        "controller": ur10e.controller_gains(data),
        "calibrated": calibrated_gains(unloaded[:2], [loaded], ur10e.PAYLOAD, body, ur10e.PUBLISHED_GAINS),
    }
    out: Figures = {"true_mass": ur10e.PAYLOAD, "gains": {name: _rounded(gain) for name, gain in gains.items()}}
    plain = {n: carried_mass(unloaded[:2], [loaded], body, gains[n]) for n in ("published", "controller")}
    out["plain_fit"] = {name: round(mass, 3) for name, mass in plain.items()}
    robots = {}
    for name, gain in gains.items():
        known = identify(unloaded, body, gain, ur10e.GEAR)
        doubt = CALIBRATED_DOUBT if name == "calibrated" else None
        drives = replace(known.drives, gain_doubt=doubt)
        robots[name] = ur10e.write(data, work / "payload" / name, drives, known.links)
        out[f"{name}_identification_residual"] = _rounded(known.residual)
    for name, recording in PAYLOAD_CASES:
        folder = robots[name].parent
        said = explain([ur10e.moving(data, recording).save(folder)], robots[name], folder / recording)
        out[f"{name}/{recording}"] = {"payload": _mass(said, ur10e.PAYLOAD), **said.summary()}
    return out


def warm(data: Path, work: Path) -> Figures:
    """UR10e identified warm, recorded cold: whether 9 minutes of warming up are seen.

    Two warm runs 4 minutes apart say how far such ratios of friction stray by themselves.
    """
    body = ur10e.body(data)
    gain = ur10e.controller_gains(data)
    known = {
        name: identify([ur10e.read(data, name)], body, gain, ur10e.GEAR)
        for name in (ur10e.COLD, ur10e.WARM, *ur10e.NO_LOAD[:2])
    }
    at_half = {name: k.drives.coulomb + 0.5 * k.drives.viscous for name, k in known.items()}
    earlier, later = (at_half[name] for name in ur10e.NO_LOAD[:2])
    folder = work / "warm"
    robot = ur10e.write(data, folder, known[ur10e.WARM].drives, known[ur10e.WARM].links)
    said = explain([ur10e.moving(data, ur10e.COLD).save(folder)], robot, folder / "out")
    return {
        "friction_cold_over_warm": _rounded(at_half[ur10e.COLD] / at_half[ur10e.WARM]),
        "friction_warm_over_warm": _rounded(earlier / later),
        **said.summary(),
    }


def balancer(data: Path, work: Path) -> Figures:
    """KR 300: its published friction is told, the hydraulic balancer on joint 2 is not; then neither is told."""
    recordings = [kr300.read(data, run) for run in kr300.RUNS]
    angle = np.concatenate([recording.position[:, kr300.BALANCED] for recording in recordings])
    stiffness, constant = np.polyfit(angle, kr300.balancer(angle), 1)
    body = Body(kr300.write(work / "balancer" / "friction_told", kr300.drives()).parent / "robot.urdf", kr300.JOINTS)
    out: Figures = {
        "published": {"stiffness": round(stiffness, 1), "at_rest": round(-constant / stiffness, 4)},
        "published_coulomb": _rounded(kr300.COULOMB),
        "published_viscous": _rounded(kr300.VISCOUS),
        "plain_friction": {r.name: _plain_friction(r, body) for r in recordings},
    }
    known = kr300.drives()
    zero = np.zeros(len(kr300.JOINTS))
    for name, told in {"friction_told": known, "nothing_told": replace(known, coulomb=zero, viscous=zero)}.items():
        robot = kr300.write(work / "balancer" / name, told)
        folder = robot.parent
        said = explain([recording.save(folder) for recording in recordings], robot, folder / "out")
        spring = next((f for f in said.findings if f["effect"] == "spring_load" and f["joint"] == 2), None)
        out[name] = {"spring": None if spring is None else spring["parameters"], **said.summary()}
    return out


STORIES: Mapping[str, tuple[str, Callable[[Path, Path], Figures]]] = {
    "payload": (ur10e.FOLDER, payload),
    "warm": (ur10e.FOLDER, warm),
    "balancer": (kr300.FOLDER, balancer),
}
"""The folder that a story needs, and the story."""


def _plain_friction(recording: Recording, body: Body) -> Figures:
    """Coulomb Nm and viscous Nm s/rad of each joint by plain least squares, links, rotors and balancer as published."""
    joints, at = body.joints, kr300.BALANCED
    lifted = np.outer(kr300.balancer(recording.position[:, at]), np.eye(joints)[at])
    run = Prepared.of(replace(recording, torque=recording.effort(np.ones(joints)) - lifted), body, np.ones(joints))
    links, rotor, *friction = np.split(run.columns, [10 * joints, 11 * joints, 12 * joints, 13 * joints], axis=2)
    left = run.effort - links @ body.parameters() - rotor @ kr300.drives().rotor
    columns = np.stack([np.einsum("njj->nj", part) for part in friction], axis=2)
    solved = np.array([np.linalg.lstsq(columns[:, j], left[:, j], rcond=None)[0] for j in range(joints)])
    return {"coulomb": _rounded(solved[:, 0]), "viscous": _rounded(solved[:, 1])}


def _mass(said: Explained, true: float) -> Figures | None:
    """The payload's mass with its 95 % interval, or None where no payload was named."""
    found = said.named("payload")
    if found is None:
        return None
    mass = found["parameters"]["mass"]
    low, high = (mass["value"] + sign * NORMAL_95 * mass["std"] for sign in (-1, 1))
    return {
        "mass": round(mass["value"], 3),
        "interval": [round(low, 3), round(high, 3)],
        "holds_true_mass": low <= true <= high,
        "error_percent": round(100 * (mass["value"] / true - 1), 2),
        "com": [round(found["parameters"][f"com_{axis}"]["value"], 4) for axis in "xyz"],
    }


def _rounded(values: Float) -> list[float]:
    return [round(float(value), 3) for value in values]
