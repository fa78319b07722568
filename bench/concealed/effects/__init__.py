"""The effects of the contract's table, and some that are in no table: put into a setting with their true figures."""

from concealed.effects.compliance import COMPLIANCE
from concealed.effects.electrics import ELECTRICS
from concealed.effects.friction import FRICTION
from concealed.effects.kinds import Kind
from concealed.effects.masses import MASSES
from concealed.effects.measurement import MEASUREMENT
from concealed.effects.unknowns import UNKNOWNS

KINDS: dict[str, Kind] = {**FRICTION, **MASSES, **COMPLIANCE, **MEASUREMENT, **ELECTRICS}
"""The contract's table, by the names that it gives."""

__all__ = ["KINDS", "UNKNOWNS", "Kind"]
