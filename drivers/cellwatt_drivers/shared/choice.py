"""Choice of what a source reads."""

from __future__ import annotations

from typing import Annotated, TypeVar

from pydantic import AfterValidator

T = TypeVar("T")


def _each_once(names: tuple[T, ...]) -> tuple[T, ...]:
    if not names or len(set(names)) != len(names):
        raise ValueError("name at least one, each once")
    return names


Chosen = Annotated[tuple[T, ...], AfterValidator(_each_once)]
"""Setting that names one or more, each once."""
