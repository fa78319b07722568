"""A controller's tags as a YAML file: the node of each channel."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from cellwatt.channel import Channel, Kind
from cellwatt.config import read_settings
from cellwatt.config.wording import did_you_mean
from cellwatt.quantity import Seconds
from cellwatt.section import Section
from cellwatt.units import CEFACT
from cellwatt_drivers.opc_ua.browse_path import Step, parsed
from cellwatt_drivers.shared.maps import KNOWN, AnyUnit, ChannelName

ModelName = Literal["opc_40010"]
Prefix = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]

Index = Annotated[int, Field(ge=0)]


_BY_NUMBER: Final = {number: name for name, number in CEFACT.items()}


class Tag(Section):
    """One variable of the server, or one element of an array."""

    node: str | None = None
    """Node id: ``ns=4;s=Robot.Power``, ``nsu=URI;i=12``, or ``ns=PREFIX;…`` with a prefix of ``namespaces``."""
    path: str | None = None
    """Browse path below Objects instead of ``node``: ``di:DeviceSet/*/rob:Axes/*2/…``; ``*`` is the first child from
    which the rest of the path exists, ``*2`` the second object by name."""
    index: Index | Annotated[tuple[Index, ...], Field(min_length=2, max_length=4)] | None = None
    """Index of the element in an array, from 0; in an array of arrays a list, like ``[1, 0]``."""
    unit: AnyUnit
    """Unit of the value times ``scale``."""
    server_unit: bool = False
    """Use the server's unit (EngineeringUnits) instead of ``unit``, if it is a unit of the same quantity."""
    scale: float = Field(1.0, allow_inf_nan=False)
    """Factor from the node's value to ``unit``."""
    kind: Kind = "continuous"
    """``discrete`` for states, ``counter`` for values that only rise."""
    window: Seconds = Field(0.0, ge=0)
    """Averaging window of each value in the controller."""
    optional: bool = False
    """If the server lacks the tag, the other tags are read without it."""

    @model_validator(mode="after")
    def _one_place(self) -> Tag:
        if (self.node is None) == (self.path is None):
            raise ValueError("write either 'node' (its id) or 'path' (its browse path)")
        if self.path is not None:
            parsed(self.path)
        if self.node is not None and not any(part[:2] in ("i=", "s=", "g=", "b=") for part in self.node.split(";")):
            raise ValueError("a node id ends in i=NUMBER, s=TEXT, g=GUID or b=BASE64, like 'ns=4;s=Robot.Power'")
        return self

    @property
    def indices(self) -> tuple[int, ...]:
        """Index in each of the nested arrays; empty for a value that is not an array."""
        if self.index is None:
            return ()
        return self.index if isinstance(self.index, tuple) else (self.index,)

    @property
    def steps(self) -> tuple[Step, ...]:
        """Steps of its browse path."""
        return parsed(self.path or "")

    @property
    def place(self) -> str:
        """Node id or browse path as written, for messages."""
        return self.node or self.path or ""

    def channel(self, name: str) -> Channel:
        """Channel for the tag; energies are held, not interpolated."""
        unit = KNOWN[self.unit][0]
        return Channel(name, unit, self.kind, "hold" if unit == "J" else None, self.window)


class TagMap(Section):
    """Tags of a controller."""

    maker: str = ""
    """Maker of the controller; omitted: as the server reports."""
    model: str = ""
    """Model of the controller; omitted: as the server reports."""
    source: str = ""
    """Source of the nodes."""
    namespaces: dict[Prefix, str] = Field(default_factory=dict)
    """Namespace URIs by the prefix used in node ids and paths; their numbers may change when a server restarts."""
    values: dict[ChannelName, Tag] = Field(min_length=1)
    """Tags by channel."""

    @model_validator(mode="after")
    def _prefixes(self) -> TagMap:
        check_prefixes(self.values, self.namespaces)
        return self


def prefix_of(node: str) -> str | None:
    """Return the prefix of ``ns=PREFIX;…``; ``None`` for a number, a URI, or no namespace."""
    first = node.partition(";")[0].strip()
    name = first.removeprefix("ns=")
    return name if name != first and not name.isdecimal() else None


def check_prefixes(tags: dict[str, Tag], namespaces: dict[str, str]) -> None:
    """Raise ``ValueError`` for a tag with a prefix that ``namespaces`` lacks."""
    for name, tag in tags.items():
        used = [prefix_of(tag.node)] if tag.node else [step.prefix for step in tag.steps]
        for prefix in used:
            if prefix and not prefix.isdecimal() and prefix not in namespaces:
                raise ValueError(f"{name}: no prefix {prefix!r} in 'namespaces'{did_you_mean(prefix, namespaces)}")


def packaged_map(name: ModelName) -> TagMap:
    """Read a packaged map."""
    return read_settings(Path(__file__).parent / "maps" / f"{name}.yaml", TagMap)


def unit_named(unit_id: int, text: str) -> str | None:
    """Return the unit of an EUInformation by its number or its text; ``None`` if unknown."""
    written = text.strip().replace("°C", "degC").replace("°", "deg").replace("·", "").replace("²", "^2")
    return _BY_NUMBER.get(unit_id) or (written if written in KNOWN else None)
