"""Settings with units written out: ``500 Hz``, ``100 ms``, ``20 GB``, ``1 deg``, ``10 %``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from cellwatt.units import factors

_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s].*?)?\s*$")

_HERTZ = {"Hz": 1.0, "kHz": 1e3}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0, "h": 3600.0, "d": 86400.0}
_BYTES = {"B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12, "KiB": 2**10, "MiB": 2**20, "GiB": 2**30}
_BYTES_PER_SECOND = {f"{unit}/s": factor for unit, factor in _BYTES.items()}
_ANGLES = factors("angle")
RADIANS = {"rad": _ANGLES["rad"], "deg": _ANGLES["deg"], "°": _ANGLES["deg"]}
_RADIANS_PER_SECOND = {f"{unit}/s": factor for unit, factor in RADIANS.items()}
FRACTION = {"%": 0.01}
_WATT = factors("power")
TABLES = (_HERTZ, SECONDS, _BYTES, _BYTES_PER_SECOND, RADIANS, _RADIANS_PER_SECOND, FRACTION, _WATT)
"""The units of each kind of quantity, with their size in the base unit."""


def parse(text: object, units: Mapping[str, float], example: str) -> float:
    """Parse a number with a unit into a float in the base unit.

    Raises ``ValueError`` that names the units if the text is not a finite number, or its unit is unknown or missing.
    """
    names = ", ".join(units)
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise ValueError(f"expected a value with a unit, like {example!r} (units: {names})")  # noqa: TRY004
    match = _NUMBER.match(text) if isinstance(text, str) else None
    unit = match[2] if match else None
    if match is None or unit is None:
        raise ValueError(f"expected a number with its unit, like {example!r} (units: {names})")
    factor = {name.lower(): size for name, size in units.items()}.get(unit.lower())
    if factor is None:
        raise ValueError(f"unknown unit {unit!r}; expected one of {names}, like {example!r}")
    number = float(match[1]) * factor
    if not math.isfinite(number):
        raise ValueError(f"expected a finite value, like {example!r}")
    return number


def _kind(units: Mapping[str, float], example: str, positive: bool = False) -> Any:
    def validate(value: object) -> object:
        # Defaults and values set from Python are floats in base units; a value in YAML must include its unit.
        number = value if type(value) is float else parse(value, units, example)
        if positive and number <= 0:
            raise ValueError(f"must be above zero, like {example!r}")
        return number

    return BeforeValidator(validate)


def _schema(example: str) -> WithJsonSchema:
    return WithJsonSchema({"type": "string", "examples": [example]})


Hertz = Annotated[float, _kind(_HERTZ, "500 Hz", positive=True), _schema("500 Hz")]
Seconds = Annotated[float, _kind(SECONDS, "100 ms"), _schema("100 ms")]
Bytes = Annotated[float, _kind(_BYTES, "20 GB", positive=True), _schema("20 GB")]
BytesPerSecond = Annotated[float, _kind(_BYTES_PER_SECOND, "2 MB/s", positive=True), _schema("2 MB/s")]
Radians = Annotated[float, _kind(RADIANS, "1 deg"), _schema("1 deg")]
RadiansPerSecond = Annotated[float, _kind(_RADIANS_PER_SECOND, "1 deg/s", positive=True), _schema("1 deg/s")]
Fraction = Annotated[float, _kind(FRACTION, "10 %"), _schema("10 %")]
Watts = Annotated[float, _kind(_WATT, "15 W"), _schema("15 W")]
