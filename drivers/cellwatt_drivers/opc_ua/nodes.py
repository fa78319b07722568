"""Finds the nodes of a map at a server and checks their values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from typing import TYPE_CHECKING, Any, Final

from cellwatt.config.wording import did_you_mean
from cellwatt.errors import WrongDeviceError
from cellwatt_drivers.opc_ua.browse_path import Child, Step, chosen
from cellwatt_drivers.opc_ua.session import Session
from cellwatt_drivers.opc_ua.tag_map import Tag, prefix_of, unit_named
from cellwatt_drivers.shared.maps import KNOWN

if TYPE_CHECKING:
    from asyncua import ua

OBJECTS: Final = "i=85"
NUMBERS: Final = range(1, 12)
"""Built-in types that are numbers: Boolean to Double."""


@dataclass(frozen=True, slots=True)
class TagPlace:
    """Source of one channel: its column, its node, the element, and the conversion to SI units."""

    column: int
    node: ua.NodeId
    index: tuple[int, ...]
    factor: float
    zero: float

    def si(self, value: Any) -> float:
        """Return a value of the node in SI units. Raises ``ValueError`` or ``TypeError`` if it is not a number."""
        found = float(reduce(getitem, self.index, value)) * self.factor - self.zero
        if math.isinf(found):
            raise ValueError("an infinite value")
        return found


class Search:
    """Finds tags at one server; browse results are cached for all tags."""

    def __init__(self, session: Session, where: str, namespaces: Mapping[str, str]) -> None:
        self._session = session
        self._where = where
        self._prefixes = namespaces
        self._uris: list[str] = []
        self._children: dict[str, list[Child]] = {}

    async def find(self, tags: Mapping[str, Tag]) -> tuple[list[TagPlace], list[str]]:
        """Return the sources of all channels, in column order, and the optional channels that the server lacks.

        Raises ``WrongDeviceError`` for the first required tag that is absent or is not a number.
        """
        from asyncua import ua

        self._uris = list(await self._session.value(ua.ObjectIds.Server_NamespaceArray) or [])
        placed, lacking = [], []
        for column, (name, tag) in enumerate(tags.items()):
            node = await self._placed(name, tag)
            if node is None:
                lacking.append(name)
            else:
                placed.append((column, name, tag, node))
        nodes = [node for *_, node in placed]
        values = await self._session.read(nodes, ua.AttributeIds.Value)
        types = await self._session.read(nodes, ua.AttributeIds.DataType)
        units = await self._session.properties(nodes, "EngineeringUnits")
        found = []
        for (column, name, tag, node), value, kind, unit in zip(placed, values, types, units, strict=True):
            if value.StatusCode is not None and value.StatusCode.name in ("BadNodeIdUnknown", "BadNodeIdInvalid"):
                if not tag.optional:
                    raise WrongDeviceError(f"{self._where} has no node {tag.place!r} ({name})")
                lacking.append(name)
                continue
            self._check(name, tag, value, kind)
            factor, zero = self._scale(name, tag, unit)
            found.append(TagPlace(column, node, tag.indices, factor, zero))
        return found, lacking

    async def _placed(self, name: str, tag: Tag) -> ua.NodeId | None:
        """Return the node of a tag; ``None`` for an optional tag without a node."""
        from asyncua import ua

        try:
            text = self._numbered(name, tag.node) if tag.node else await self._walked(name, tag.steps)
        except WrongDeviceError:
            if tag.optional:
                return None
            raise
        try:
            return ua.NodeId.from_string(text)
        except (ua.UaError, ValueError, TypeError) as error:
            raise WrongDeviceError(f"{name}: {tag.place!r} is not a node id") from error

    def _numbered(self, name: str, node: str) -> str:
        """Return a node id with the number of its namespace."""
        prefix = prefix_of(node)
        rest = node.partition(";")[2]
        if prefix is not None:
            return f"ns={self._number(name, self._prefixes[prefix])};{rest}"
        if node.startswith("nsu="):
            uri, _, rest = node.removeprefix("nsu=").partition(";")
            return f"ns={self._number(name, uri)};{rest}"
        return node

    def _number(self, name: str, uri: str) -> int:
        if uri not in self._uris:
            raise WrongDeviceError(
                f"{self._where} has no namespace {uri!r}{did_you_mean(uri, self._uris)} ({name}; it has: "
                f"{', '.join(self._uris)})"
            )
        return self._uris.index(uri)

    async def _walked(self, name: str, steps: Sequence[Step]) -> str:
        """Return the node at the end of a browse path; the error names the step at which the longest attempt failed."""
        numbers = [self._namespace(name, step) for step in steps]
        furthest: tuple[int, list[Child]] = (-1, [])

        async def walk(node: str, depth: int) -> str | None:
            nonlocal furthest
            if depth == len(steps):
                return node
            if node not in self._children:
                self._children[node] = await self._session.children(node)
            children = self._children[node]
            if depth > furthest[0]:
                furthest = depth, children
            for child in chosen(steps[depth], children, numbers[depth]):
                if (end := await walk(child.node, depth + 1)) is not None:
                    return end
            return None

        if (end := await walk(OBJECTS, 0)) is not None:
            return end
        depth, children = furthest
        above = "/".join(("Objects", *map(str, steps[:depth])))
        near = did_you_mean(steps[depth].name, [c.name for c in children])
        raise WrongDeviceError(f"{self._where} has no {str(steps[depth])!r} below {above}{near} ({name})")

    def _namespace(self, name: str, step: Step) -> int | None:
        if not step.prefix:
            return None
        return int(step.prefix) if step.prefix.isdecimal() else self._number(name, self._prefixes[step.prefix])

    def _check(self, name: str, tag: Tag, value: ua.DataValue, kind: ua.DataValue) -> None:
        """Raise ``WrongDeviceError`` unless the value is a number, or an array of numbers with that element."""
        node = f"{self._where}: {tag.place!r} ({name})"
        status = value.StatusCode.name if value.StatusCode is not None else "Good"
        if status in ("BadUserAccessDenied", "BadNotReadable", "BadAttributeIdInvalid"):
            raise WrongDeviceError(f"{node} cannot be read: {status}")
        variant = value.Value
        if variant is None or variant.Value is None:
            declared: Any = kind.Value.Value if kind.Value is not None else None
            if getattr(declared, "NamespaceIndex", 1) == 0 and declared.Identifier in range(12, 23):  # String and on
                raise WrongDeviceError(f"{node} is a {_type(int(declared.Identifier))}, expected a number")
            return
        number = int(getattr(variant.VariantType, "value", variant.VariantType))
        if number not in NUMBERS:
            raise WrongDeviceError(f"{node} is a {_type(number)}, expected a number")
        if wrong := misplaced(variant.Value, tag.indices):
            raise WrongDeviceError(f"{node} {wrong}")

    def _scale(self, name: str, tag: Tag, info: Any) -> tuple[float, float]:
        """Return factor and zero to SI units; the server's own unit applies if the tag has ``server_unit``."""
        si, unit = KNOWN[tag.unit]
        given = None
        if info is not None:
            number, text = getattr(info, "UnitId", None), getattr(getattr(info, "DisplayName", None), "Text", None)
            given = unit_named(int(number or 0), str(text or ""))
        if given is not None and given != tag.unit:
            its, other = KNOWN[given]
            if tag.server_unit and its == si:
                unit = other
            elif its != si or other != unit:
                raise WrongDeviceError(
                    f"{self._where}: {tag.place!r} ({name}) is in {given}, the settings say {tag.unit}"
                )
        return tag.scale * unit.factor, unit.zero * unit.factor


def misplaced(value: Any, index: tuple[int, ...]) -> str:
    """Return why an index does not select a number of a value; empty if it does."""
    shape = _shape(value)
    size = " × ".join(map(str, shape))
    if not shape and index:
        return "is not an array: leave out 'index'"
    if len(shape) != len(index):
        each = "" if len(shape) == 1 else f" for each dimension, like [{', '.join('0' * len(shape))}]"
        return f"is an array of {size}: write 'index', from 0{each}"
    try:
        picked = reduce(getitem, index, value)
    except IndexError:
        return f"has {size} elements, none with index {', '.join(map(str, index))}"
    return "" if isinstance(picked, int | float) else f"has {picked!r} where a number is expected"


def _shape(value: Any) -> tuple[int, ...]:
    """Lengths of nested arrays, from the first element of each."""
    if not isinstance(value, list):
        return ()
    return (len(value), *(_shape(value[0]) if value else ()))


def _type(number: int) -> str:
    from asyncua import ua

    try:
        return str(ua.VariantType(number).name)
    except ValueError:
        return f"type {number}"
