"""From the settings' channels to a recipe for the controller, and from its data packages to columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt.channel import Channel
from cellwatt.config.wording import did_you_mean
from cellwatt.errors import ProtocolError
from cellwatt_drivers.ur.fields import FIELDS, Field
from cellwatt_drivers.ur.wire import ELEMENTS, Package

BUS_POWER = Channel("bus.power", "W")
"""Voltage × current of the arm's 48 V bus, multiplied packet by packet."""
_VOLTAGE, _CURRENT = FIELDS["actual_robot_voltage"], FIELDS["actual_robot_current"]

_OFFERED = {c.name: (f, i) for f in FIELDS.values() for i, c in enumerate(f.channels)}


@dataclass(frozen=True)
class Selection:
    """Fields to request, and the channels to deliver from them.

    ``fields`` in the order of the recipe (the timestamp comes before them), ``picks`` the elements of each field that
    become channels, ``power`` whether ``bus.power`` is the last channel.
    """

    fields: tuple[Field, ...]
    picks: tuple[tuple[int, ...], ...]
    power: bool

    @classmethod
    def of(cls, wanted: Sequence[str]) -> Selection:
        """Select RTDE fields and single channels by name. Raises ``ValueError`` that names the wrong one."""
        chosen: dict[str, list[int]] = {}
        power = False
        for name in wanted:
            if name == BUS_POWER.name:
                twice, power = power, True
            else:
                field, elements = _lookup(name)
                already = chosen.setdefault(field.name, [])
                twice = not set(already).isdisjoint(elements)
                already.extend(elements)
            if twice:
                raise ValueError(f"{name} is chosen twice")
        if power:
            chosen.setdefault(_VOLTAGE.name, [])
            chosen.setdefault(_CURRENT.name, [])
        if not chosen:
            raise ValueError("no channel is chosen")
        return cls(tuple(FIELDS[n] for n in chosen), tuple(tuple(e) for e in chosen.values()), power)

    @property
    def names(self) -> tuple[str, ...]:
        """The fields to request from the controller, timestamp first."""
        return ("timestamp", *(f.name for f in self.fields))

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels delivered, in column order."""
        picked = tuple(f.channels[i] for f, elements in zip(self.fields, self.picks, strict=True) for i in elements)
        return (*picked, BUS_POWER) if self.power else picked


def _lookup(name: str) -> tuple[Field, Sequence[int]]:
    """The field for the name of a field or channel, and the indices of the elements meant."""
    if name in _OFFERED:
        field, element = _OFFERED[name]
        return field, (element,)
    known = FIELDS.get(name)
    if known is not None and known.channels:
        return known, range(known.width)
    if name == "timestamp":
        raise ValueError("timestamp is always read: it is the time of the samples, not a channel")
    if known is not None:
        raise ValueError(f"{name} is not offered: its unit is unknown or not supported")
    hint = did_you_mean(name, [*_OFFERED, *FIELDS, BUS_POWER.name])
    raise ValueError(f"no RTDE field or channel {name!r}{hint}")


class Decoder:
    """Decodes runs of data packages into columns: many packages at once, adjacent fields of one type as one block.

    ``types`` are the controller's answer for ``selection.names``. Raises ``ProtocolError`` if their number or widths do
    not match the requested fields.
    """

    def __init__(self, selection: Selection, recipe: int, types: Sequence[str]) -> None:
        self.columns = len(selection.channels)
        expected = [FIELDS[n].width for n in selection.names]
        if [ELEMENTS[t][1] if t in ELEMENTS else 0 for t in types] != expected or types[0] != "DOUBLE":
            raise ProtocolError(f"the controller declares {', '.join(types)} for {', '.join(selection.names)}")
        positions = self._lay_out(types)
        self.package = Package(recipe, self._dtype.itemsize)
        self._copies: list[tuple[str, slice | list[int], slice]] = []
        """Segment, indices of its elements, and the columns to which they are copied."""
        self._scales: list[tuple[slice, float]] = []
        at = 0
        for field, picks, (segment, start) in zip(selection.fields, selection.picks, positions[1:], strict=True):
            target = slice(at, at + len(picks))
            at = target.stop
            self._copy([start + i for i in picks], segment, target)
            if field.scale != 1.0 and picks:
                self._scales.append((target, field.scale))
        self._factors: tuple[tuple[str, int], ...] = ()
        if selection.power:
            self._factors = tuple(positions[selection.names.index(f.name)] for f in (_VOLTAGE, _CURRENT))

    def _lay_out(self, types: Sequence[str]) -> list[tuple[str, int]]:
        """Set the numpy type of a package; returns segment and first element of each field."""
        segments: list[tuple[str, int]] = []
        positions = []
        for name in types:
            code, width = ELEMENTS[name]
            if not segments or segments[-1][0] != code:
                segments.append((code, 0))
            before = segments[-1][1]
            positions.append((f"s{len(segments) - 1}", before))
            segments[-1] = (code, before + width)
        body = [(f"s{i}", code, (width,)) for i, (code, width) in enumerate(segments)]
        self._dtype = np.dtype([("header", "u1", (4,)), *body])
        return positions

    def _copy(self, source: list[int], segment: str, target: slice) -> None:
        """Add a copy; elements adjacent in both package and columns are copied as one slice."""
        if not source:
            return
        if source != list(range(source[0], source[0] + len(source))):
            self._copies.append((segment, source, target))
            return
        whole = slice(source[0], source[-1] + 1)
        before, last, columns = self._copies[-1] if self._copies else ("", [], target)
        if before == segment and isinstance(last, slice) and last.stop == whole.start:
            whole = slice(last.start, whole.stop)
            target = slice(columns.start, target.stop)
            self._copies.pop()
        self._copies.append((segment, whole, target))

    def decode(self, data: memoryview, count: int) -> tuple[Float, Float]:
        """Controller time (count,) s and values (count, channels) in SI units; neither is a view of ``data``."""
        packages = np.frombuffer(data, self._dtype, count)
        time = packages["s0"][:, 0].astype(np.float64)
        values = np.empty((count, self.columns))
        for segment, source, target in self._copies:
            values[:, target] = packages[segment][:, source]
        for target, scale in self._scales:
            values[:, target] *= scale
        if self._factors:
            (first, i), (second, j) = self._factors
            values[:, -1] = packages[first][:, i] * packages[second][:, j]
        return time, values
