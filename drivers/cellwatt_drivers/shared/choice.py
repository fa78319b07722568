"""Types of settings that several drivers share."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, TypeVar

from pydantic import AfterValidator

from cellwatt.config.wording import did_you_mean
from cellwatt.errors import ConfigError

T = TypeVar("T")


def _each_once(names: tuple[T, ...]) -> tuple[T, ...]:
    if len(set(names)) != len(names):
        raise ValueError("name each once")
    return names


def _some(names: tuple[T, ...]) -> tuple[T, ...]:
    if not names:
        raise ValueError("name at least one, each once")
    return names


EachOnce = Annotated[tuple[T, ...], AfterValidator(_each_once)]
"""Names each once, or none."""
Chosen = Annotated[tuple[T, ...], AfterValidator(_some), AfterValidator(_each_once)]
"""Names one or more, each once."""


def among(wanted: tuple[str, ...] | None, known: Collection[str], owner: str, key: str = "read") -> tuple[str, ...]:
    """Return the wanted names, or all known ones. Raises ``ConfigError`` if the ``owner`` of the names lacks one."""
    names = tuple(known) if wanted is None else wanted
    if unknown := [name for name in names if name not in known]:
        hint = did_you_mean(unknown[0], known)
        raise ConfigError(f"{key}: {owner} has no {', '.join(unknown)}{hint} (it has: {', '.join(known)})")
    return names


def whole_part_of(fastest: float) -> AfterValidator:
    """A rate that is ``fastest``, Hz, divided by a whole number."""

    def check(rate: float) -> float:
        every = fastest / rate
        if every < 1 - 1e-9 or abs(every - round(every)) > 1e-6:
            raise ValueError(
                f"{rate:g} Hz: write {fastest:g} Hz or a whole part of it "
                f"({fastest / 2:g} Hz, {fastest / 4:g} Hz, {fastest / 5:g} Hz …)"
            )
        return rate

    return AfterValidator(check)


def _path(port: str) -> str:
    if not port.startswith("/"):
        raise ValueError("expected the path of a serial port, like '/dev/serial/by-id/usb-…' or '/dev/ttyUSB0'")
    return port


SerialPath = Annotated[str, AfterValidator(_path)]
"""Path of a serial port."""
