"""Names of table columns: the quantity, joint and unit that a name means.

Seven families of names are known: this project's tables (``q_1``, ``tau_1``, ``power``), Universal Robots' RTDE records
(``actual_q_0``, ``target_qd_0``), MuJoCo's arrays (``qpos0``, ``ctrl0``), ROS's joint states (``position[0]``,
``effort[0]``), Isaac's (``joint_pos_0``, ``dof_pos_0``), libfranka's (``dq_1``, ``tau_J_1``) and the channels of a cell
(``arm.joint_1.position``, ``supply.power``). Capitals do not matter; a number may be written ``_1``, `` 1``, ``.1`` or
``[1]``, and a path may stand before the name (``/joint_states/effort[0]``). Joints are numbered from 1, or from 0
where there is a 0. A unit may follow: ``q_1 [deg]``, ``q_3 [mm]`` of a
linear axis, ``tau_1 (Nm)``, ``power_kW``; without one, values are in the SI unit of the quantity.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Final, NamedTuple

from cellwatt.errors import ConfigError
from cellwatt.units import TABLE, Unit, kind_of

JOINT: Final[Mapping[str, tuple[str, ...]]] = {
    quantity: tuple(names.split())
    for quantity, names in {
        "position": "q actual_q position qpos joint_pos joint_position joint_positions dof_pos jointposition "
        "joint_angle measured_position actual_position theta",
        "velocity": "qd actual_qd velocity qvel joint_vel joint_velocity joint_velocities dof_vel dq jointvelocity "
        "measured_velocity actual_velocity theta_dot qdot",
        "acceleration": "qdd acceleration qacc joint_acc joint_accelerations ddq",
        "torque": "tau torque actual_current_as_torque qfrc_actuator applied_torque effort joint_torque "
        "joint_torques joint_effort joint_efforts measured_effort dof_torque dof_force tau_j jointtorque "
        "measured_torque actual_torque appliedjointmotortorque",
        "torque_ratio": "torque_percent torque_ratio",
        "current": "current actual_current",
        "temperature": "temperature joint_temperatures",
        "target_position": "target_q target_position q_d",
        "target_velocity": "target_qd target_velocity dq_d",
        "target_acceleration": "target_qdd target_acceleration",
        "command": "command joint_pos_target",
        "actuator_force": "actuator_force",
        "control": "ctrl",
        "came_from": "q_from came_from",
    }.items()
}
"""Names of a joint's quantity, each before the joint's number, in the order in which they are preferred."""
WHOLE: Final[Mapping[str, tuple[str, ...]]] = {
    quantity: tuple(names.split())
    for quantity, names in {
        "time": "t timestamp time utc stamp sim_time __time utime elapsed_time seconds sec",
        "supply.power": "power supply_power active_power act_power total_act_power apower watt watts",
        "bus.power": "bus_power",
        "tool.payload": "payload",
    }.items()
}
"""Names of quantities without a joint, likewise; names with a dot may follow the name of a source."""

_STEMS: Final = {**JOINT, **WHOLE}
_TEMPERATURE: Final = TABLE["temperature"]
_POSITION: Final = {**TABLE["angle"], **TABLE["length"]}
_VELOCITY: Final = {**TABLE["angular_velocity"], **TABLE["velocity"]}
_LINEAR: Final = {f"{name}/s^2": Unit(f"{name}/s^2", unit.factor) for name, unit in TABLE["length"].items()}
_ACCELERATION: Final = {**TABLE["angular_acceleration"], **_LINEAR}
_EFFORT: Final = {**TABLE["torque"], **TABLE["force"]}
_UNITS: Final[Mapping[str, Mapping[str, Unit]]] = {
    **dict.fromkeys(("position", "target_position", "command", "came_from"), _POSITION),
    **dict.fromkeys(("velocity", "target_velocity"), _VELOCITY),
    **dict.fromkeys(("acceleration", "target_acceleration"), _ACCELERATION),
    **dict.fromkeys(("torque", "actuator_force"), _EFFORT),
    "torque_ratio": {"1": Unit("1"), "%": Unit("%", 0.01)},
    "current": TABLE["current"],
    "temperature": {**_TEMPERATURE, "C": _TEMPERATURE["degC"]},
    "control": {"1": Unit("1")},
    "time": {"s": Unit("s"), "ms": Unit("ms", 1e-3), "us": Unit("us", 1e-6), "ns": Unit("ns", 1e-9)},
    **dict.fromkeys(("supply.power", "bus.power"), TABLE["power"]),
    "tool.payload": TABLE["mass"],
}
"""Units of each quantity by name, the SI unit first."""

_SHORT: Final = {
    "degrees?|°": "deg",
    "radians?": "rad",
    "newtons?-?": "n",
    "met(?:er|re)s?": "m",
    "milli": "m",
    "micro|\u03bc": "u",
    "nano": "n",
    "sec(?:ond)?s?": "s",
    "watts?": "w",
    "amp(?:ere)?s?": "a",
    "percent": "%",
    "s\\^?[-\u2212]1": "/s",
    "s\\^?[-\u2212]2": "/s^2",
    "\\*\\*2|(?<=s)2": "^2",
    "[ ·⋅.*]|(?<=n)-(?=m)": "",
}
"""Spellings of units, in small letters, and their abbreviations."""
_MILLI: Final = ("mW", "mNm")
"""Units that are taken for millions of the SI unit if they begin with a capital."""
_MEGA = re.compile("M(?!(?i:illi))")
_BRACKETS = re.compile(r"(?P<name>.*?)(?:\s*[\[(]|\s+/(?=\s))\s*(?P<unit>[^\[\]()]*?)\s*[\])]?")
_CHANNEL = re.compile(r"(?:(?P<source>.+)\.)?joint_?(?P<number>\d+)[._](?P<stem>\w+)")
_NUMBERED = re.compile(
    r"(?P<path>(?:.*/|data\.|field\.|(?:robot_)?state\.)?)(?P<stem>[a-z_]*[a-z])(?:[_.]?(?P<number>\d+)|\[(?P<index>\d+)\])"
)


@dataclass(frozen=True, slots=True)
class Name:
    """A parsed column name."""

    quantity: str
    """A key of ``JOINT`` or ``WHOLE``."""
    family: str
    """Common name of columns numbered together: the stem, or the source and a dot."""
    number: int | None
    """Joint number as written; None for a quantity without a joint."""
    unit: str | None
    """Unit as written, None without one."""
    joint: str = ""
    """Name of the joint, for a column that names it."""
    stem: str = ""
    """Name of the quantity of a numbered joint, at the end of the column's name."""


class _Called(NamedTuple):
    """Names of columns as a user gives them, and as they are looked up."""

    names: Sequence[tuple[str, str]]
    patterns: Sequence[tuple[str, re.Pattern[str]]]
    columns: set[str]
    """Columns looked up."""


_NONE: Final = _Called((), (), set())
_OF_THE_USER: ContextVar[_Called] = ContextVar("of_the_user")


@contextmanager
def called(names: Sequence[tuple[str, str]]) -> Iterator[Callable[[], list[str]]]:
    """Within the context also accept a user's names of columns: ``("tau", "Moment{}")`` reads ``Moment1`` as ``tau_1``,
    ``("q [deg]", "A{}")`` reads ``A1`` as ``q_1`` in degrees. A quantity may have several names.

    Yields a function that lists the user's names that no column had so far, none before a column was looked up.
    Raises ``ConfigError`` if the first of a pair is not a known name.
    """
    patterns, columns = [], set[str]()
    for name, written in names:
        before, numbered, after = written.partition("{}")
        stem, bracket, unit = name.partition("[")
        stem = re.sub(r"_?\{\}$", "", stem.strip())  # "q_{}" means "q"
        known = f"{stem}{'_{}' if numbered else ''} {bracket}{unit}"
        if re.search(r"[{}]", f"{stem}{unit}") or understood(known.format(1)) is None:
            raise ConfigError(f"--columns: {name!r} is no name of a quantity, such as q, q [deg], tau, t [ms] or power")
        number = r"(?P<number>\d+)" if numbered else ""
        patterns.append((known, re.compile(re.escape(before) + number + re.escape(after))))

    def unused() -> list[str]:
        own = zip(names, patterns, strict=True)
        return [written for (_, written), (_, pattern) in own if columns and not any(map(pattern.fullmatch, columns))]

    before_it = _OF_THE_USER.set(_Called(names, patterns, columns))
    try:
        yield unused
    finally:
        _OF_THE_USER.reset(before_it)


def names_called() -> Sequence[tuple[str, str]]:
    """The user's names of columns in the innermost ``called``."""
    return _OF_THE_USER.get(_NONE).names


def understood(written: str) -> Name | None:
    """Parse a column's name; None if it is unknown."""
    user = _OF_THE_USER.get(_NONE)
    if user.names:
        user.columns.add(written.strip())
    for known, pattern in user.patterns:
        if (match := pattern.fullmatch(written.strip())) is not None:
            return parsed(known.format(*match.groups()), _named)
    return parsed(written, _named)


def unit_in(written: str) -> str | None:
    """The unit in brackets behind a name, None without one."""
    match = _BRACKETS.fullmatch(written.strip())
    return match["unit"] if match else None


def parsed(written: str, parse: Callable[[str, str | None], Name | None]) -> Name | None:
    """Parse a column's name by ``parse``, which is given the name without its unit, and the unit."""
    text = written.strip()
    if (match := _BRACKETS.fullmatch(text)) is not None and not match["unit"].isdigit():
        return parse(match["name"], match["unit"] or None)
    if (name := parse(text, None)) is not None:
        return name
    for cut in re.finditer("[_ ]", text):  # a unit at the end: ``q_1_deg``, ``velocity_2_deg_s``
        unit = text[cut.end() :].replace("_", "/")
        name = parse(text[: cut.start()], unit)
        if name is not None and scale(name.quantity, unit) is not None:
            return name
    return None


def scale(quantity: str, unit: str | None) -> tuple[float, float] | None:
    """Factor and offset that convert a value in ``unit`` to the SI unit of its quantity; None for an unknown unit.

    Case is ignored, except that of M before W and Nm: ``MW`` is no ``mW``.
    """
    found = Unit("") if unit is None else _spelt(unit, _UNITS[quantity])
    return None if found is None else (found.factor, float(found.si(0.0)))


def unit_named(text: str) -> Unit | None:
    """A unit of ``TABLE``, however it is spelled: ``W``, ``Watts``; None for other texts."""
    return _spelt(text, {name: unit for units in TABLE.values() for name, unit in units.items()})


def _spelt(text: str, units: Mapping[str, Unit]) -> Unit | None:
    plain = unicodedata.normalize("NFKC", text).casefold()
    for spelling, short in _SHORT.items():
        plain = re.sub(spelling, short, plain)
    found = {name.casefold(): unit for name, unit in units.items()}.get(plain)
    return None if found is not None and found.name in _MILLI and _MEGA.match(text.strip()) else found


def along(unit: str | None) -> bool | None:
    """True for a unit of a linear axis, False for one of a revolute joint, None for other units."""
    found = unit_named(unit or "")
    kind = None if found is None else kind_of(found.name)
    linear = kind in ("length", "velocity", "force")
    return linear if linear or kind in ("angle", "angular_velocity", "torque") else None


def units_of(quantity: str) -> tuple[str, ...]:
    """Units that a quantity may be written in, the SI unit first."""
    return tuple(_UNITS[quantity])


def is_unit(text: str) -> bool:
    """True for a unit of any quantity, other than 1."""
    return text != "1" and any(scale(quantity, text) is not None for quantity in _UNITS)


def rank(quantity: str, family: str) -> int:
    """Position of a family among the names of its quantity; channels of a source come last."""
    stems = _STEMS[quantity]
    return stems.index(family) if family in stems else len(stems)


def usual(quantity: str, joint: int | None = None) -> str:
    """The name under which messages ask for a quantity: ``q_3``, ``power``."""
    stem = _STEMS[quantity][0]
    return stem if joint is None else f"{stem}_{joint}"


def _named(text: str, unit: str | None) -> Name | None:
    name = text.casefold().replace(" ", "_")
    for quantity in WHOLE:
        if "." in quantity and (name == quantity or name.endswith(f".{quantity}")):
            return Name(quantity, name.removesuffix(quantity), None, unit)
        if name in WHOLE[quantity]:
            return Name(quantity, name, None, unit)
    if (match := _CHANNEL.fullmatch(name)) is not None:
        family = f"{match['source'] or ''}."
        number = match["number"]
    elif (match := _NUMBERED.fullmatch(name)) is not None:
        family = match["path"] + match["stem"]
        number = match["number"] or match["index"]
    else:
        return None
    stem = match["stem"]
    unit = unit or ("%" if stem == "torque_percent" else None)
    if unit in ("%", "percent") and stem in JOINT["torque"]:
        return Name("torque_ratio", family, int(number), unit, stem=stem)
    found = (quantity for quantity, stems in JOINT.items() if stem in stems)
    return next((Name(each, family, int(number), unit, stem=stem) for each in found), None)
