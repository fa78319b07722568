"""Types of settings that several drivers share."""

from __future__ import annotations

from typing import Annotated, TypeVar

from pydantic import AfterValidator

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
