"""Units of a joint's quantities: a revolute joint has rad and Nm where a prismatic one has m and N."""

from __future__ import annotations

import re
from typing import Final, Literal

Kind = Literal["revolute", "prismatic"]

_ALONG: Final = {"N*m": "N", "N·m": "N", "Nm": "N", "kg*m^2": "kg", "kg·m²": "kg", "kg m²": "kg", "rad": "m"}
_UNITS: Final = re.compile("|".join(rf"(?<![A-Za-z]){re.escape(unit)}(?![A-Za-z²])" for unit in _ALONG))


def unit_at(kind: Kind, unit: str) -> str:
    """The unit at a joint of this ``kind`` of a quantity that has ``unit`` at a revolute one.

    ``unit_at("prismatic", "Nm s/rad")`` is ``"N s/m"``, of ``"N*m"`` it is ``"N"``, of ``"kg*m^2"`` it is ``"kg"``.
    Units of other things (W, °C, s) stay.
    """
    return unit if kind == "revolute" else _UNITS.sub(lambda found: _ALONG[found.group()], unit)
