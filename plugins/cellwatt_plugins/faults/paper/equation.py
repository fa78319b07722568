"""A power equation, and its YAML file that people can read and programs can evaluate.

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
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field

from cellwatt.arrays import Float
from cellwatt.config import KeyPath, read_settings
from cellwatt.errors import ModelError
from cellwatt.files import write_file
from cellwatt_plugins.faults.paper.rational import Complex, Rational

FORMULA = "abs(K + sum(r[k] / (1j*t - p[k]))) W, t in s"

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Pairs = tuple[tuple[_Finite, _Finite], ...]


class PowerEquation(BaseModel):
    """A power pattern of ``duration`` s as an equation in t; the module's docstring describes its keys.

    ``task`` and ``speed`` name the task of the reference, if the pattern belongs to one.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    cellwatt_power_equation: Literal[1]
    formula: str = Field(alias="power")
    task: str | None = None
    speed: _Finite | None = None
    order: Annotated[int, Field(ge=1)]
    duration: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    rms: tuple[_Finite, ...]
    K: _Finite
    p: _Pairs
    r: _Pairs

    @classmethod
    def of(cls, response: Rational, duration: float, rms: Sequence[float]) -> PowerEquation:
        """The equation of a fitted ``response``; ``rms`` W is eq. (19) after each iteration."""
        return cls(
            cellwatt_power_equation=1,
            power=FORMULA,
            order=len(response.poles),
            duration=duration,
            rms=tuple(rms),
            K=response.constant,
            p=_pairs(response.poles),
            r=_pairs(response.residues),
        )

    @cached_property
    def response(self) -> Rational:
        """The fitted response, whose magnitude at s = j t is the pattern."""
        poles, residues = (np.array([complex(*pair) for pair in pairs]) for pairs in (self.p, self.r))
        return Rational(poles, residues, self.K)

    def power(self, t: Float) -> Float:
        """The pattern (n,) W at t (n,) s."""
        return np.abs(self.response.at(np.asarray(1j * t, np.complex128)))


def save(equation: PowerEquation, path: Path) -> None:
    """Write the YAML file. Raises ``CellwattError`` if it cannot be written."""
    content = equation.model_dump(by_alias=True, exclude_none=True)
    content["rms"] = [float(f"{value:.4g}") for value in equation.rms]
    write_file(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=118))


def load(path: Path) -> PowerEquation:
    """Read the YAML file. Raises ``ModelError`` with file, key and the expected content."""
    return read_settings(path, PowerEquation, _check, refusal=ModelError, computed=True)


def _check(file: PowerEquation) -> Iterator[tuple[KeyPath, str]]:
    if not len(file.p) == len(file.r) == file.order:
        yield ("order",), f"order {file.order} needs as many p and r, found {len(file.p)} and {len(file.r)}"
    for i, (real, _) in enumerate(file.p):
        if math.isclose(real, 0.0, abs_tol=1e-12):
            yield ("p", i), "found a pole on the imaginary axis, which makes the power infinite"


def _pairs(values: Complex) -> _Pairs:
    return tuple((value.real, value.imag) for value in values.tolist())
