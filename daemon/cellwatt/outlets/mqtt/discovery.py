"""The cell as Home Assistant is told of it: a device and its sensors, by MQTT discovery. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from cellwatt.outlets.mqtt.message import Labels, level
from cellwatt.version import __version__

_CLASSES: Final[Mapping[str, tuple[str, ...]]] = {
    "power": ("W", "mW", "kW"),
    "apparent_power": ("VA",),
    "reactive_power": ("var",),
    "energy": ("J", "kJ", "MJ", "Wh", "kWh"),
    "voltage": ("V",),
    "current": ("A", "mA"),
    "temperature": ("°C", "°F", "K"),
    "frequency": ("Hz",),
    "pressure": ("Pa", "kPa", "bar"),
    "distance": ("m", "mm"),
    "speed": ("m/s", "mm/s"),
    "duration": ("s",),
    "weight": ("kg", "g"),
}
_CLASS_OF: Final = {unit: name for name, units in _CLASSES.items() for unit in units}
_SHOWN: Final = {"degC": "°C", "degF": "°F", "deg": "°", "deg/s": "°/s", "deg/s^2": "°/s²", "1": None}


def name_of(root: str) -> str:
    """Name of the device in the topics of Home Assistant, which allow letters, digits, ``_`` and ``-``."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", root)


def device(root: str, site: str, cell: str, labels: Labels, by_channel: bool) -> dict[str, Any]:
    """The discovery message of a cell whose topics are below ``root``; ``by_channel``: each channel has its own."""
    id_ = name_of(root)
    components = {
        f"{id_}_{name_of(name)}": _sensor(id_, root, name, labels, by_channel) for name in labels.units
    } | _state(id_, root)
    return {
        "device": {
            "identifiers": [id_],
            "name": f"{site} {cell}",
            "manufacturer": "cellwatt",
            "sw_version": __version__,
        },
        "origin": {"name": "cellwatt", "sw_version": __version__},
        "availability_topic": f"{root}/availability",
        "components": components,
    }


def _sensor(id_: str, root: str, name: str, labels: Labels, by_channel: bool) -> dict[str, Any]:
    unit = _SHOWN.get(labels.units[name], labels.units[name])
    class_, kind = _CLASS_OF.get(unit or ""), labels.kinds[name]
    # A row may lack a channel: the sensor then stays as it is. Jinja's dot would find a method of the dict.
    template = (
        "{{ value_json['value'] }}"
        if by_channel
        else f"{{{{ value_json['values'].get({_quoted(name)}, this.state) }}}}"
    )
    told = {
        "platform": "sensor",
        "unique_id": f"{id_}_{name_of(name)}",
        "name": name,
        "state_topic": f"{root}/frame/{level(name)}" if by_channel else f"{root}/frame",
        "value_template": template,
        "unit_of_measurement": unit,
        "device_class": class_,
        "state_class": {"continuous": "measurement", "counter": "total_increasing"}.get(kind),
    }
    return {key: value for key, value in told.items() if value is not None}


def _state(id_: str, root: str) -> dict[str, Any]:
    """What the cell as a whole says: its health, and its task."""
    return {
        f"{id_}_problem": {
            "platform": "binary_sensor",
            "unique_id": f"{id_}_problem",
            "name": "Problem",
            "device_class": "problem",
            "state_topic": f"{root}/health",
            "value_template": "{{ 'OFF' if value_json['state'] == 'green' else 'ON' }}",
        },
        f"{id_}_task": {
            "platform": "sensor",
            "unique_id": f"{id_}_task",
            "name": "Task",
            "state_topic": f"{root}/task",
            "value_template": "{{ value_json['name'] }}",
        },
        f"{id_}_task_energy": {
            "platform": "sensor",
            "unique_id": f"{id_}_task_energy",
            "name": "Energy of the last task",
            "device_class": "energy",
            "unit_of_measurement": "J",
            "state_topic": f"{root}/energy",
            "value_template": "{{ value_json['total'] }}",
        },
    }


def _quoted(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"
