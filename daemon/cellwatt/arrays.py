"""Types of the arrays that go through the whole of cellwatt, and rows of records that hold several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]
Nanoseconds = NDArray[np.int64]
Qualities = NDArray[np.uint8]
"""``Quality`` of each sample, as a number."""

Record = TypeVar("Record", bound="DataclassInstance")


def joined(parts: Sequence[Record]) -> Record:
    """One dataclass with the rows of the arrays of all ``parts``, in order; what is no array is that of the first."""
    whole = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _arrays(parts[0])}
    return replace(parts[0], **whole)


def rows_of(record: Record, kept: slice | NDArray[Any]) -> Record:
    """The same dataclass with some rows of each of its arrays; what is no array stays."""
    return replace(record, **{name: getattr(record, name)[kept] for name in _arrays(record)})


def _arrays(record: Record) -> list[str]:
    return [f.name for f in fields(record) if f.init and isinstance(getattr(record, f.name), np.ndarray)]
