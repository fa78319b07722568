"""One check per rule of the driver contract: ``async def check(rig, folder)`` raises if the rule is broken."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from functools import partial
from pathlib import Path
from typing import Any

from cellwatt.testing.checks.cancellation import cancels_anywhere
from cellwatt.testing.checks.faults import survives
from cellwatt.testing.checks.loop import keeps_the_loop_free
from cellwatt.testing.checks.rates import keeps_its_rates
from cellwatt.testing.checks.reading_only import only_reads
from cellwatt.testing.checks.reconnect import reconnects
from cellwatt.testing.checks.settings import settings_are_checked
from cellwatt.testing.checks.stamps import stamps_are_right
from cellwatt.testing.checks.start_stop import starts_and_stops
from cellwatt.testing.checks.values import values_are_in_their_units
from cellwatt.testing.rig import Rig

Check = Callable[[Rig, Path], Coroutine[Any, Any, None]]

CHECKS: tuple[Check, ...] = (
    settings_are_checked,
    starts_and_stops,
    cancels_anywhere,
    reconnects,
    stamps_are_right,
    keeps_its_rates,
    values_are_in_their_units,
    only_reads,
    keeps_the_loop_free,
)

__all__ = ["CHECKS", "Check", "checks_of", "survives"]


def checks_of(rig: Rig) -> dict[str, Check]:
    """All checks of a driver by name: ``CHECKS``, and one for each fault that its emulator can inject."""
    found: dict[str, Check] = {check.__name__: check for check in CHECKS}
    for kind in rig.emulator.faults:
        found[f"survives_{kind}"] = partial(survives, kind=kind)
    return found
