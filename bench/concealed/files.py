"""A case as the files say it, for the baselines and the scores: they see what the product sees."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from concealed.arms import Array


@dataclass(frozen=True)
class Robot:
    """What robot.yaml and its URDF say; (n, …) arrays in the units of `Arm`."""

    axes: Array
    origins: Array
    mass: Array
    com: Array
    inertia: Array
    rotor: Array
    coulomb: Array
    viscous: Array
    constant: Array
    resistance: Array
    standby: float

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.mass)

    @property
    def flange(self) -> Array:
        """The frame of the last link: the description has no other."""
        return np.zeros(3)

    @property
    def family(self) -> str:
        """A name for the model."""
        return "described"


@dataclass(frozen=True)
class Run:
    """One recording beside its simulation: t (N,), the planned q, v, a and both torques (N, n), both powers (N,)."""

    name: str
    t: Array
    q: Array
    v: Array
    a: Array
    simulated: Array
    measured: Array
    simulated_power: Array
    measured_power: Array


def triple(element: ET.Element | None, attribute: str) -> list[float]:
    """Three numbers of an attribute."""
    assert element is not None
    return [float(x) for x in element.attrib[attribute].split()]


def load_robot(folder: Path) -> Robot:
    """Read robot.yaml and the URDF beside it; link frames without rotation, as this benchmark writes them."""
    spec = yaml.safe_load((folder / "robot.yaml").read_text())
    root = ET.fromstring((folder / spec["urdf"]).read_text())
    joints, links = root.findall("joint"), [x for x in root.findall("link") if x.find("inertial") is not None]
    inertia = [x.find("inertial/inertia") for x in links]
    of = lambda name: np.array([j.get(name, 0.0) for j in spec["joints"]], float)  # noqa: E731
    return Robot(
        np.array([triple(j.find("axis"), "xyz") for j in joints]),
        np.array([triple(j.find("origin"), "xyz") for j in joints]),
        np.array([float(x.find("inertial/mass").attrib["value"]) for x in links]),  # type: ignore[union-attr]
        np.array([triple(x.find("inertial/origin"), "xyz") for x in links]),
        np.array([[float(i.attrib[k]) for k in ("ixx", "iyy", "izz")] for i in inertia if i is not None]),
        of("rotor_inertia"),
        of("coulomb_friction"),
        of("viscous_friction"),
        of("torque_constant"),
        of("winding_resistance"),
        float(spec.get("standby_power", 0.0)),
    )


def group(table: pa.Table, name: str) -> Array:
    """(N, n) of the columns name_1, name_2, …"""
    found = [c for c in table.column_names if c.startswith(f"{name}_") and c[len(name) + 1 :].isdigit()]
    return np.stack([table[f"{name}_{j + 1}"].to_numpy() for j in range(len(found))], axis=1).astype(float)


def load_run(recording: Path, keys: Path) -> Run:
    """One recording and what the simulation says at its times: in the keys where the simulation has its own clock."""
    seen = pq.read_table(recording)
    beside = recording.with_name(recording.name.replace(".recording.", ".simulation."))
    told = pq.read_table(aligned if (aligned := keys / beside.name).exists() else beside)
    return Run(
        recording.name.split(".")[0],
        seen["t"].to_numpy().astype(float),
        group(told, "q"),
        group(told, "qd"),
        group(told, "qdd"),
        group(told, "tau"),
        group(seen, "tau"),
        told["power"].to_numpy().astype(float),
        seen["power"].to_numpy().astype(float),
    )


def load_runs(folder: Path, keys: Path) -> list[Run]:
    """All recordings of a folder in order."""
    return [load_run(p, keys) for p in sorted(folder.glob("*.recording.parquet"))]


def thinned(run: Run, rows: int) -> Run:
    """About `rows` evenly spaced samples of the run."""
    keep = slice(None, None, max(1, len(run.t) // rows))
    return Run(run.name, *(getattr(run, f)[keep] for f in list(Run.__dataclass_fields__)[1:]))


def noise_of(residual: Array) -> Array:
    """Noise per channel from second differences at the full rate, robust against steps (median)."""
    second = np.diff(residual, n=2, axis=0)
    return np.asarray(np.median(np.abs(second), axis=0) / 0.6745 / np.sqrt(6.0))
