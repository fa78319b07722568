"""Numbers and units as text, rounded to their significant digits."""

from __future__ import annotations

import math

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SIGNS = {"*": "·", "^2": "²", "^3": "³", "Ohm": "Ω", "ohm": "Ω", "degC": "°C", "degF": "°F", "deg": "°"}


def unit(text: str) -> str:
    """A unit as printed, e.g. ``N·m`` for ``N*m``."""
    for plain, sign in _SIGNS.items():
        text = text.replace(plain, sign)
    return text


def fixed(value: float | None, decimals: int) -> str:
    """A number with ``decimals`` decimals and a true minus sign; a dash if None or not finite."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"
    return text.replace("-", "−")


def decimals_for(scale: float, digits: int = 2) -> int:
    """Number of decimals that show ``digits`` digits of ``scale``; 2 if ``scale`` is not positive and finite."""
    if not math.isfinite(scale) or scale <= 0:
        return 2
    return digits - 1 - math.floor(math.log10(scale))


def number(value: float, digits: int = 3) -> str:
    """A number with ``digits`` significant digits."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    power = math.floor(math.log10(abs(value)))
    if power >= 5 or power < -3:
        return f"{fixed(value / 10.0**power, digits - 1)}·10{str(power).translate(_SUPERSCRIPT)}"
    return fixed(value, decimals_for(abs(value), digits))


def measured(value: float, std: float) -> str:
    """``4.1 ± 0.2``: the deviation with one digit (two if it starts with 1), the value with the same decimals."""
    if not math.isfinite(value) or not math.isfinite(std) or std <= 0:
        return number(value)
    power = math.floor(math.log10(max(abs(value), std)))
    shift = power if power >= 5 or power < -3 else 0
    value, std = value / 10.0**shift, std / 10.0**shift
    lead = std / 10.0 ** math.floor(math.log10(std))
    decimals = decimals_for(std, 2 if lead < 1.95 else 1)
    text = f"{fixed(value, decimals)} ± {fixed(std, decimals)}"
    return f"({text})·10{str(shift).translate(_SUPERSCRIPT)}" if shift else text


def times(ratio: float) -> str:
    """A ratio as a multiple, e.g. ``3.1×``."""
    return "–" if not math.isfinite(ratio) else f"{ratio:.0f}×" if ratio >= 9.95 else f"{ratio:.1f}×"


def capital(text: str) -> str:
    """The text with its first letter in upper case."""
    return text[:1].upper() + text[1:]


def listed(parts: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
