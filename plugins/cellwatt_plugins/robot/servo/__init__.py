"""Arms whose drives measure no torque: position servos of a known law, and the effects that motion alone shows."""

from cellwatt_plugins.robot.effects import EFFECTS
from cellwatt_plugins.robot.effects.effect import Effect
from cellwatt_plugins.robot.servo.dead_band import DriveDeadBand
from cellwatt_plugins.robot.servo.delay import CommandDelay
from cellwatt_plugins.robot.servo.gain import DriveGain
from cellwatt_plugins.robot.servo.limit import DriveLimit
from cellwatt_plugins.robot.servo.play import Play
from cellwatt_plugins.robot.servo.presliding import BuiltUp

OF_DRIVES: tuple[Effect, ...] = (CommandDelay(), DriveDeadBand(), DriveGain(), DriveLimit())
"""Deviations of a drive from its law."""
OTHERWISE: tuple[Effect, ...] = (BuiltUp(), Play())
"""Effects that motion shows in another way than torque does."""
_INSTEAD = {effect.name for effect in OTHERWISE} | {"joint_elasticity"}
IN_MOTION: tuple[Effect, ...] = (
    *(e for e in EFFECTS if e.acts_on not in ("reading", "supply") and e.name not in _INSTEAD),
    *OTHERWISE,
    *OF_DRIVES,
)
"""All effects that motion and commands show where no torque was measured."""
BY_NAME_IN_MOTION: dict[str, Effect] = {effect.name: effect for effect in IN_MOTION}
