"""Units of a joint's quantities: rad and Nm at a revolute joint, m and N at a prismatic one."""

from __future__ import annotations

import re
from typing import Final, Literal

Kind = Literal["revolute", "prismatic"]

_ALONG: Final = {"N*m": "N", "N·m": "N", "Nm": "N", "kg*m^2": "kg", "kg·m²": "kg", "kg m²": "kg", "rad": "m"}
_UNITS: Final = re.compile("|".join(rf"(?<![A-Za-z]){re.escape(unit)}(?![A-Za-z²])" for unit in _ALONG))


def unit_at(kind: Kind, unit: str) -> str:
    """The unit, at a joint of this ``kind``, of a quantity that has ``unit`` at a revolute joint.

    ``unit_at("prismatic", "Nm s/rad")`` is ``"N s/m"``; ``"N*m"`` becomes ``"N"``, ``"kg*m^2"`` becomes ``"kg"``.
    Units of other quantities (W, °C, s) are unchanged.
    """
    return unit if kind == "revolute" else _UNITS.sub(lambda found: _ALONG[found.group()], unit)
