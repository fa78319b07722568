"""Errors of predictions of the absolute sum of torques; eqs. 4–7 of the paper."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Scores:
    """One method on poses that it has not seen."""

    rmse: float
    """Nm (eq. 4)."""
    r2: float
    """Eq. 5."""
    mape: float
    """Mean absolute error as a share of the measured value, per cent. Eq. 6 as printed lacks the division."""
    mean_absolute: float
    """Nm; a hundred times this is what eq. 6 says as printed."""

    @property
    def accuracy(self) -> float:
        """Eq. 7: 100 − MAPE."""
        return 100.0 - self.mape

    @classmethod
    def of(cls, measured: Float, predicted: Float) -> Scores:
        """For values (N,) each, Nm."""
        error = predicted - measured
        return cls(
            rmse=float(np.sqrt(np.mean(error**2))),
            r2=float(1 - np.mean(error**2) / np.var(measured)),
            mape=float(100 * np.mean(np.abs(error) / np.abs(measured))),
            mean_absolute=float(np.mean(np.abs(error))),
        )

    def as_json(self) -> dict[str, Any]:
        """For ``--json``."""
        return {**asdict(self), "accuracy": self.accuracy}
