"""``cellwatt train static``: all methods on one set of poses, the best model's file, and findings about the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.progress import stage
from cellwatt_plugins.models.static import exported, paper
from cellwatt_plugins.models.static.basis import Basis
from cellwatt_plugins.models.static.effects import Effects
from cellwatt_plugins.models.static.exported import Widths
from cellwatt_plugins.models.static.findings import Finding, findings
from cellwatt_plugins.models.static.identify import (
    Checked,
    HeldArm,
    identify,
    identify_checked,
    with_leftover,
)
from cellwatt_plugins.models.static.paper import Sigmoids
from cellwatt_plugins.models.static.poses import Poses


@dataclass(frozen=True)
class Scores:
    """Errors of one method on held-out poses."""

    rmse: float
    """Nm (eq. 4)."""
    r2: float
    """Eq. 5."""
    mape: float
    """Mean absolute error as a share of the measured value, per cent; values of 0 do not count. Eq. 6 as printed lacks
    the division."""
    mean_absolute: float
    """Nm; eq. 6 as printed gives a hundred times this."""

    @property
    def accuracy(self) -> float:
        """Eq. 7: 100 − MAPE."""
        return 100.0 - self.mape

    @classmethod
    def of(cls, measured: Float, predicted: Float) -> Scores:
        """Scores of values (N,) each, Nm."""
        error = predicted - measured
        loaded = measured != 0  # an arm that stands straight up may need no torque, of which an error has no share
        return cls(
            rmse=float(np.sqrt(np.mean(error**2))),
            r2=float(1 - np.mean(error**2) / np.var(measured)),
            mape=float(100 * np.mean(np.abs(error[loaded] / measured[loaded]))),
            mean_absolute=float(np.mean(np.abs(error))),
        )

    def as_json(self) -> dict[str, Any]:
        """Return the scores as ``--json`` prints them."""
        return {**asdict(self), "accuracy": self.accuracy}


SHARES: Final = (0.2, 0.8)
"""Approximate shares of a training's time: the best model on held-out poses, and the published networks."""
PUBLISHED: Final = {
    "gravity": (29.31, 0.687, 15.783),
    "network": (30.19, 0.663, 16.671),
    "hybrid": (13.19, 0.936, 4.271),
}
"""Table III of the paper: RMSE Nm, R², MAPE %."""
COVERAGE: Final = 0.9
"""Share of new poses within the interval around the prediction."""


@dataclass(frozen=True)
class Method:
    """One row of the table."""

    name: str
    scores: Scores
    neurons: int | None = None


@dataclass(frozen=True)
class Trained:
    """Result of a training."""

    methods: tuple[Method, ...]
    """Scores on the fifth of the poses that was held out of all methods."""
    checked: Checked
    scores: Scores
    """Scores of the best model on all poses, each held out in turn."""
    widths: Widths
    findings: tuple[Finding, ...]
    poses: Poses
    residual: Float
    """(N, n) Nm: measured minus modelled torque of all poses."""
    networks: tuple[Sigmoids, Sigmoids]
    """The paper's plain network, and its hybrid's network."""

    @property
    def scatter(self) -> float:
        """Nm: share of the best model's RMSE that is the scatter of repeated measurements of a pose."""
        return min(float(np.sqrt(np.sum(self.checked.model.posterior.noise**2))), self.scores.rmse)

    @property
    def left_out(self) -> list[str]:
        """A sentence on the poses with outliers, whose torques were not used; empty if there are none."""
        odd = np.unique(np.argwhere(self.checked.model.odd)[:, 0]) + 1
        return [f"Not used, as they are outliers: torques in pose {', '.join(map(str, odd))}."] if odd.size else []

    def as_json(self) -> dict[str, Any]:
        """Return the result as ``--json`` prints it."""
        return {
            "poses": len(self.poses),
            "methods": [
                {
                    "name": m.name,
                    "neurons": m.neurons,
                    **m.scores.as_json(),
                    "published": dict(zip(("rmse", "r2", "mape"), PUBLISHED[m.name], strict=True))
                    if m.name in PUBLISHED
                    else None,
                }
                for m in self.methods
            ],
            "best": {
                **self.scores.as_json(),
                "leftover": self.checked.model.leftover is not None,
                "interval": {"coverage": COVERAGE, "told_nm": self.widths.known, "blind_nm": self.widths.blind},
                "noise_nm": self.checked.model.posterior.noise.tolist(),
                "scatter_nm": self.scatter,
            },
            "findings": [asdict(finding) for finding in self.findings],
            "odd": [[int(pose) + 1, int(joint) + 1] for pose, joint in np.argwhere(self.checked.model.odd)],
            "notes": list(self.poses.notes),
        }


@stage("", sum(SHARES))
def train(poses: Poses, arm: HeldArm) -> Trained:
    """Train all methods. Raises ``RecordingError`` if friction would drive a joint."""
    basis, effects = arm.basis(poses), arm.effects(poses)
    with stage("", share=SHARES[0]):
        checked = identify_checked(poses, basis, effects)
    if driven := [arm.arm.description.names[j] for j in np.flatnonzero(checked.model.driven_by_friction)]:
        raise RecordingError(
            f"torque of {', '.join(driven)} has the opposite sign, or the poses' side of approach is the other one: "
            "friction would drive the joint"
        )
    with stage("networks as published", 1, share=SHARES[1]):
        methods, networks = _published(poses, basis, effects)
    scores = Scores.of(poses.total, checked.predicted)
    sided = half_width(checked.predicted - poses.total)
    widths = Widths(sided, max(sided, half_width(checked.blind - poses.total)))
    best = Method("best", _held_out(poses, basis, effects, checked))
    causes = tuple(findings(checked.model, arm, basis))
    residual = poses.torque - checked.model.torque(basis)
    return Trained((*methods, best), checked, scores, widths, causes, poses, residual, networks)


def half_width(errors: Float) -> float:
    """Half width that contains at least ``COVERAGE`` of new errors like ``errors`` (N,), whatever their distribution.

    Split conformal prediction on the errors of held-out poses (Vovk, Gammerman, Shafer 2005; on cross-validation
    Barber et al., Annals of Statistics 49, 2021).
    """
    size = np.sort(np.abs(errors))
    rank = int(np.ceil((len(size) + 1) * COVERAGE))
    return float(size[min(rank, len(size)) - 1])


def write(trained: Trained, arm: HeldArm, out: Path) -> list[Path]:
    """Write the model files: the best, and the paper's three."""
    plain, hybrid = trained.networks
    files = [out / "model.onnx", *(out / "paper" / f"{name}.onnx" for name in PUBLISHED)]
    exported.write_best(files[0], trained.checked.model, trained.widths, arm, trained.poses)
    exported.write_paper(files[1], None, arm, trained.poses, with_gravity=True)
    exported.write_paper(files[2], plain, arm, trained.poses, with_gravity=False)
    exported.write_paper(files[3], hybrid, arm, trained.poses, with_gravity=True)
    return files


def _published(poses: Poses, basis: Basis, effects: Effects) -> tuple[list[Method], tuple[Sigmoids, Sigmoids]]:
    """The paper's methods on its 80/20 split."""
    rows, test = paper.split(len(poses))
    gravity = basis.vertical @ effects.cad
    simulated = np.sum(np.abs(gravity), axis=1)
    both = np.hstack([poses.q, gravity])
    pairs = [(poses.q[rows], poses.total[rows]), (both[rows], poses.total[rows] - simulated[rows])]
    plain, hybrid = paper.searched(pairs)
    predictions: Sequence[tuple[str, Float, int | None]] = (
        ("gravity", simulated, None),
        ("network", plain(poses.q), plain.neurons),
        ("hybrid", simulated + hybrid(both), hybrid.neurons),
    )
    methods = [Method(name, Scores.of(poses.total[test], value[test]), neurons) for name, value, neurons in predictions]
    return methods, (plain, hybrid)


def _held_out(poses: Poses, basis: Basis, effects: Effects, checked: Checked) -> Scores:
    """Scores of the best model on the same split."""
    rows, test = paper.split(len(poses))
    model = identify(basis.rows(rows), poses.torque[rows], effects)
    if checked.model.leftover is not None:
        model = with_leftover(model, basis.rows(rows), poses.torque[rows])
    return Scores.of(poses.total[test], model.total(basis.rows(test)))
