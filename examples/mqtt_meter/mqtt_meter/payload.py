"""The meter's JSON: an object of numbers, named as the Shelly Pro 3EM names them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

from cellwatt import Channel, ProtocolError

Field = Literal["total_act_power", "total_aprt_power", "total_current", "a_voltage", "b_voltage", "c_voltage"]
FIELDS: tuple[Field, ...] = get_args(Field)
CHANNELS: dict[Field, Channel] = {
    "total_act_power": Channel("supply.power", "W"),
    "total_aprt_power": Channel("supply.apparent_power", "VA"),
    "total_current": Channel("supply.current", "A"),
    "a_voltage": Channel("phase_1.voltage", "V"),
    "b_voltage": Channel("phase_2.voltage", "V"),
    "c_voltage": Channel("phase_3.voltage", "V"),
}


def parse(payload: bytes, fields: Sequence[Field]) -> list[float]:
    """Values in the order of ``fields``, NaN for one that is null or not there. Raises ``ProtocolError``."""
    try:
        message = json.loads(payload)
    except ValueError as error:
        raise ProtocolError(f"expected JSON, got {payload[:80]!r}") from error
    if not isinstance(message, dict) or not any(f in message for f in fields):
        raise ProtocolError(f"expected an object with {', '.join(fields)}, got {payload[:80]!r}")
    return [_number(message.get(f), f) for f in fields]


def build(values: Mapping[str, float]) -> bytes:
    """A message as the meter publishes it."""
    return json.dumps({"id": 0, **{name: round(value, 3) for name, value in values.items()}}).encode()


def _number(value: object, field: str) -> float:
    if value is None:
        return float("nan")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ProtocolError(f"expected a number as {field}, got {value!r}")
    return float(value)
