"""Units as OPC UA names them."""

from __future__ import annotations

from typing import Final

from cellwatt_drivers.shared.maps import KNOWN

_CODES: Final = {
    "DD": "deg", "C81": "rad", "C25": "mrad", "E96": "deg/s", "2A": "rad/s", "RPM": "rpm", "2B": "rad/s^2",
    "MTR": "m", "MMT": "mm", "MTS": "m/s", "C16": "mm/s", "MSK": "m/s^2", "NEW": "N", "B47": "kN", "NU": "Nm",
    "KGM": "kg", "GRM": "g", "CEL": "degC", "KEL": "K", "FAH": "degF", "PAL": "Pa", "KPA": "kPa", "BAR": "bar",
    "AMP": "A", "4K": "mA", "B22": "kA", "VLT": "V", "2Z": "mV", "KVT": "kV", "WTT": "W", "KWT": "kW", "MAW": "MW",
    "D46": "VA", "KVA": "kVA", "D44": "var", "KVR": "kvar", "JOU": "J", "KJO": "kJ", "3B": "MJ", "WHR": "Wh",
    "KWH": "kWh", "MWH": "MWh", "HTZ": "Hz", "KHZ": "kHz", "SEC": "s", "C26": "ms", "MIN": "min", "HUR": "h",
    "P1": "%", "C62": "1",
}  # fmt: skip
"""By common code of UN/CEFACT recommendation 20, which OPC UA writes as a number."""
_BY_NUMBER: Final = {int.from_bytes(code.encode(), "big"): name for code, name in _CODES.items()}


def named(unit_id: int, text: str) -> str | None:
    """Return the unit that an EUInformation means by its number or its text; ``None`` for one that is not known."""
    written = text.strip().replace("°C", "degC").replace("°", "deg").replace("·", "").replace("²", "^2")
    return _BY_NUMBER.get(unit_id) or (written if written in KNOWN else None)
