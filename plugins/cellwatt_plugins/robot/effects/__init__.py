"""Effects: physics that an arm can have beyond its description; one module each, in a folder for each kind.

To add an effect, write its module.
"""

import importlib
import pkgutil
from inspect import isabstract

from cellwatt_plugins.robot.curves import CURVES
from cellwatt_plugins.robot.effects.effect import Effect
from cellwatt_plugins.robot.effects.friction import Friction


def _written_here() -> list[Effect]:
    """One instance of each effect that a module below this folder defines, sorted by name."""
    modules = [importlib.import_module(found.name) for found in pkgutil.walk_packages(__path__, f"{__name__}.")]
    kinds = {
        kind
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, Effect) and not isabstract(kind)
    }
    return sorted((kind() for kind in kinds), key=lambda effect: effect.name)


EFFECTS: tuple[Effect, ...] = tuple(_written_here())
BY_NAME: dict[str, Effect] = {effect.name: effect for effect in (*EFFECTS, *CURVES)}
FRICTION: tuple[Friction, ...] = tuple(effect for effect in EFFECTS if isinstance(effect, Friction))
"""The laws of friction."""
