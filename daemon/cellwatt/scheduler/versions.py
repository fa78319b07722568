"""Versions of what takes part: equal results need the same cellwatt, Python and numpy everywhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from cellwatt.errors import CellwattError
from cellwatt.scheduler.place import Place

PACKAGES: Final = ("cellwatt", "numpy", "distributed")


def check_versions(client: Any, place: Place) -> None:
    """Raise ``CellwattError`` where the scheduler or a worker has another version of what gives the results."""
    told = client.get_versions(packages=PACKAGES)
    here = _versions(told["client"])
    there = [(str(place), told["scheduler"])]
    there += [(f"the worker {address}", theirs) for address, theirs in sorted(told["workers"].items())]
    for who, theirs in there:
        for name, version in _versions(theirs).items() if theirs else ():  # a worker may leave meanwhile
            if version != here[name]:
                has = f"has {name} {version}" if version else f"has no {name}"
                raise CellwattError(f"{who} is refused: it {has}, here is {name} {here[name]}; install the same there")


def _versions(told: Mapping[str, Any]) -> dict[str, str | None]:
    python = ".".join(str(told["host"]["python"]).split(".")[:2])
    return {"Python": python} | {name: told["packages"].get(name) for name in PACKAGES}
