"""Pages of Robot Web Services ⇄ values; pure functions.

Source: Robot Web Services, 3HAC050973: a page is XHTML whose ``<li class=…>`` hold ``<span class=NAME>VALUE</span>``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree

from cellwatt.errors import ProtocolError

RobotWare = Literal[6, 7]
Page = Literal["state", "energy"]
LARGEST = 1 << 20  # bytes of a page

ENERGY = "/rw/system/energy"
EXECUTION = "/rw/rapid/execution"
SPEED = "/rw/panel/speedratio"
MODE = "/rw/panel/opmode"
SYSTEM = "/rw/system"
LOGOUT = "/logout"
CONTROLLER = {6: "/rw/panel/ctrlstate", 7: "/rw/panel/ctrl-state"}

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Item:
    """One ``<li>`` of a page: its class, its title, its spans by class, and the ``inside`` items of its own list."""

    kind: str
    title: str
    values: Mapping[str, str]
    inside: tuple[Item, ...] = ()


@dataclass(frozen=True, slots=True)
class Energy:
    """The controller's energy measurement in its own unit; ``interval`` in s, ``joints`` of the last interval.

    ``valid`` is the controller's validity flag of the measurement; ``count`` rises with each new one.
    """

    valid: bool
    count: int
    state: str
    interval: float
    interval_energy: float
    accumulated: float
    joints: tuple[float, ...]


def items(page: bytes) -> list[Item]:
    """All ``<li>`` of a page in order, those of inner lists too. Raises ``ProtocolError`` if it is not XHTML."""
    try:
        root = ElementTree.fromstring(page)
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        raise ProtocolError(f"a page of Robot Web Services is not XHTML: {error}") from error
    return [
        Item(
            element.get("class", ""),
            element.get("title", ""),
            {s.get("class", ""): (s.text or "").strip().strip('"') for s in element.findall("{*}span")},
        )
        for element in root.findall(".//{*}li")
    ]


def value(page: bytes, name: str) -> str:
    """The first value of this name in a page, e.g. ``ctrlstate``. Raises ``ProtocolError`` if there is none."""
    for item in items(page):
        if name in item.values:
            return item.values[name]
    raise ProtocolError(f"a page of Robot Web Services lacks {name!r}")


def ratio(page: bytes) -> float:
    """Speed override, 0 … 1."""
    percent = _number(value(page, "speedratio"))
    return percent / 100


def energy(page: bytes, unit: str) -> Energy:
    """Parse the energy page; ``joints`` are those of the mechanical unit named ``unit``. Raises ``ProtocolError``."""
    found = items(page)
    state = next((i.values for i in found if i.kind.startswith("sys-energy-state")), None)
    if state is None:
        raise ProtocolError("the energy page of Robot Web Services lacks its state")
    joints: list[float] = []
    of_unit = False
    for item in found:
        if item.kind.startswith("sys-energy-mec"):
            of_unit = item.title == unit
        elif of_unit and item.kind.startswith("sys-energy-axis"):
            joints.append(_number(item.values.get("interval-energy", "")))
    return Energy(
        valid=state.get("state") == "0",
        count=int(_number(state.get("change-count") or "0")),
        state=state.get("energy-state", ""),
        interval=_number(state.get("interval-length", "")),
        interval_energy=_number(state.get("interval-energy", "")),
        accumulated=_number(state.get("accumulated-energy", "")),
        joints=tuple(joints),
    )


def _number(text: str) -> float:
    if not text:
        return _NAN
    try:
        number = float(text)
    except ValueError as error:
        raise ProtocolError(f"{text!r} in a page of Robot Web Services is not a number") from error
    if not math.isfinite(number):
        raise ProtocolError(f"{text!r} in a page of Robot Web Services is not finite")
    return number


def page(title: str, entries: Iterable[Item]) -> bytes:
    """A page in XHTML."""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<html xmlns="http://www.w3.org/1999/xhtml">\n'
        f'<head><title>{title}</title><base href="http://localhost/rw/"/></head>\n'
        f'<body><div class="state"><a href="" rel="self"/><ul>{_listed(entries)}</ul></div></body>\n</html>\n'
    ).encode()


def _listed(entries: Iterable[Item]) -> str:
    text = ""
    for e in entries:
        spans = "".join(f'<span class="{name}">{value}</span>' for name, value in e.values.items())
        inside = f"<ul>{_listed(e.inside)}</ul>" if e.inside else ""
        text += f'<li class="{e.kind}" title="{e.title}">{spans}{inside}</li>'
    return text
