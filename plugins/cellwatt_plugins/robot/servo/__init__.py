"""Arms whose drives tell no torque: position servos of a known law, and the physics that shows in motion alone."""

from cellwatt_plugins.robot.effects import EFFECTS
from cellwatt_plugins.robot.effects.effect import Effect
from cellwatt_plugins.robot.servo.dead_band import DriveDeadBand
from cellwatt_plugins.robot.servo.delay import CommandDelay
from cellwatt_plugins.robot.servo.gain import DriveGain
from cellwatt_plugins.robot.servo.limit import DriveLimit
from cellwatt_plugins.robot.servo.play import Play

OF_DRIVES: tuple[Effect, ...] = (CommandDelay(), DriveDeadBand(), DriveGain(), DriveLimit())
"""What a drive does otherwise than its law."""
IN_MOTION: tuple[Effect, ...] = (
    *(e for e in EFFECTS if e.acts_on not in ("reading", "supply") and e.relations.family != "two_mass"),
    Play(),
    *OF_DRIVES,
)
"""All that motion and commands show where no torque was measured."""
BY_NAME_IN_MOTION: dict[str, Effect] = {effect.name: effect for effect in IN_MOTION}
