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
    names = [f.name for f in fields(parts[0]) if isinstance(getattr(parts[0], f.name), np.ndarray)]
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def rows_of(record: Record, kept: slice | NDArray[Any]) -> Record:
    """The same dataclass with some rows of each of its arrays; what is no array stays."""
    arrays = {f.name: value for f in fields(record) if isinstance(value := getattr(record, f.name), np.ndarray)}
    return replace(record, **{name: value[kept] for name, value in arrays.items()})
