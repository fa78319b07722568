"""Stores a power equation in a YAML file that people can read and programs can evaluate.

cellwatt_power_equation: 1                                   version of this format
power: abs(K + sum(r[k] / (1j*t - p[k]))) W, t in s          how to evaluate it
task: task_1                                                 of a reference; absent if it belongs to none
speed: 1.0
order: 44
duration: 7.8                                                s
rms: [0.329, 0.26, ...]                                      W, eq. (19) after each iteration
K: 116.2
p: [[-0.05, 0.74], [-0.05, -0.74], ...]                      real and imaginary parts
r: [[1.2, -0.3], [1.2, 0.3], ...]
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from cellwatt.config import KeyPath, read_settings
from cellwatt.errors import ModelError
from cellwatt.files import write_file
from cellwatt_plugins.faults.paper.bevf import PowerEquation
from cellwatt_plugins.faults.paper.rational import Rational

FORMULA = "abs(K + sum(r[k] / (1j*t - p[k]))) W, t in s"

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class _File(BaseModel):
    """Content of the file; the module's docstring describes it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    cellwatt_power_equation: Literal[1]
    power: str
    task: str | None = None
    speed: _Finite | None = None
    order: Annotated[int, Field(ge=1)]
    duration: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    rms: tuple[_Finite, ...]
    K: _Finite
    p: tuple[tuple[_Finite, _Finite], ...]
    r: tuple[tuple[_Finite, _Finite], ...]


def save(equation: PowerEquation, path: Path) -> None:
    """Write the YAML file. Raises ``CellwattError`` if it cannot be written."""
    content = {
        "cellwatt_power_equation": 1,
        "power": FORMULA,
        **({} if equation.task is None else {"task": equation.task, "speed": equation.speed}),
        "order": equation.order,
        "duration": equation.duration,
        "rms": [float(f"{value:.4g}") for value in equation.rms],
        "K": equation.response.constant,
        "p": _pairs(equation.response.poles),
        "r": _pairs(equation.response.residues),
    }
    write_file(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=118))


def load(path: Path) -> PowerEquation:
    """Read the YAML file. Raises ``ModelError`` with file, line, column and the expected content."""
    file = read_settings(path, _File, _check, refusal=ModelError, computed=True)
    return PowerEquation(
        Rational(_complex(file.p), _complex(file.r), file.K), file.duration, file.rms, file.task, file.speed
    )


def _check(file: _File) -> Iterator[tuple[KeyPath, str]]:
    if not len(file.p) == len(file.r) == file.order:
        yield ("order",), f"order {file.order} needs as many p and r, found {len(file.p)} and {len(file.r)}"
    for i, (real, _) in enumerate(file.p):
        if math.isclose(real, 0.0, abs_tol=1e-12):
            yield ("p", i), "found a pole on the imaginary axis, which makes the power infinite"


def _pairs(values: NDArray[np.complex128]) -> list[list[float]]:
    return [[value.real, value.imag] for value in values.tolist()]


def _complex(pairs: tuple[tuple[float, float], ...]) -> NDArray[np.complex128]:
    return np.array([complex(real, imaginary) for real, imaginary in pairs])
