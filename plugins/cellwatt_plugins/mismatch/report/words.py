"""Findings in plain words: numbers rounded to what is known of them, names, places, the verdict's sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cellwatt_plugins.mismatch.fit.solution import Trial
from cellwatt_plugins.mismatch.report.trace import joint_of
from cellwatt_plugins.mismatch.verdict.findings import Alternative, Finding, Findings, Span

UNKNOWN = "unknown"
"""The effect's name where something is there that the library does not hold."""
MOST_CAUSES = 3
"""Named in the verdict's sentence; more are counted."""
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SIGNS = {"*": "·", "^2": "²", "^3": "³", "Ohm": "Ω", "ohm": "Ω", "degC": "°C"}
_NAMES = {"stribeck": "Stribeck", "coulomb": "Coulomb"}
_WORDS = ((0.99, "near certain"), (0.95, "very likely"), (0.8, "likely"), (0.5, "more likely than not"))


def unit(text: str) -> str:
    """A unit as printed, e.g. ``N·m`` for ``N*m``."""
    for plain, sign in _SIGNS.items():
        text = text.replace(plain, sign)
    return text


def fixed(value: float, decimals: int) -> str:
    """Decimals as told, with a true minus sign; a dash where not finite."""
    if not math.isfinite(value):
        return "–"
    text = f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"
    return text.replace("-", "−")


def decimals_for(scale: float, digits: int = 2) -> int:
    """Decimals that show ``digits`` digits of ``scale``; 2 where it is no size at all."""
    if not math.isfinite(scale) or scale <= 0:
        return 2
    return digits - 1 - math.floor(math.log10(scale))


def number(value: float, digits: int = 3) -> str:
    """A number alone, to that many digits."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    power = math.floor(math.log10(abs(value)))
    if power >= 5 or power < -3:
        return f"{fixed(value / 10.0**power, digits - 1)}·10{str(power).translate(_SUPERSCRIPT)}"
    return fixed(value, decimals_for(abs(value), digits))


def measured(value: float, std: float) -> str:
    """``4.1 ± 0.2``: the deviation to one digit (two where it starts with 1), the value to the same place."""
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


def confidence(share: float) -> str:
    """A word and the percentage, never rounded up to certainty."""
    if not math.isfinite(share):
        return "confidence not stated"
    word = next((w for least, w in _WORDS if share >= least), "a guess")
    percent = ">99" if share > 0.99 else f"{math.floor(share * 100 + 1e-9)}"
    return f"{word}, {percent} %"


def effect_name(effect: str) -> str:
    """An effect's identifier as a person would say it."""
    if effect == UNKNOWN:
        return "an effect that is not in the library"
    text = effect.replace("_dependent", "-dependent").replace("_", " ")
    return " ".join(_NAMES.get(word, word) for word in text.split(" "))


def named(what: Finding | Alternative | Trial) -> str:
    """Effect and joint, e.g. ``Stribeck friction (joint 2)``."""
    name = effect_name(what.effect)
    return name if what.joint is None else f"{name} (joint {what.joint})"


def channel_name(channel: str) -> str:
    """A channel as a person would say it."""
    joint = joint_of(channel)
    return f"joint {joint} torque" if joint is not None else "supply power" if channel == "power" else channel


def capital(text: str) -> str:
    """The text with its first letter in upper case."""
    return text[:1].upper() + text[1:]


def listed(parts: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def between(limits: tuple[float, float], suffix: str) -> str:
    """A range with its unit, e.g. ``−0.30 to 0.30 rad/s``."""
    return f"{fixed(limits[0], 2)} to {fixed(limits[1], 2)} {suffix}"


def degrees(limits: tuple[float, float]) -> str:
    """A range of angles in degrees, for those who think in them."""
    return between(limits, "rad") + f" ({fixed(math.degrees(limits[0]), 0)} to {fixed(math.degrees(limits[1]), 0)}°)"


def moments(parts: Sequence[Span], most: int = 2) -> str:
    """The first few stretches of time and how many more there are."""
    text = ", ".join(f"{s.recording} {fixed(s.start, 1)} to {fixed(s.end, 1)} s" for s in parts[:most])
    return text + (f" and {len(parts) - most} more" if len(parts) > most else "")


def _causes(findings: Sequence[Finding]) -> str:
    names = [named(f) for f in findings]
    more = len(names) - MOST_CAUSES
    return listed(names if more <= 0 else [*names[:MOST_CAUSES], f"{more} more"])


def _open_places(findings: Findings) -> str:
    """Where something stays unexplained, e.g. ``joint 3 and the supply power``."""
    joints = [f.joint for f in findings.findings if f.effect == UNKNOWN]
    joints += [joint_of(rest.channel) for rest in findings.unexplained]
    places = [f"joint {j}" for j in sorted({j for j in joints if j is not None})]
    return listed(places + (["the supply"] if None in joints else []))


def verdict(findings: Findings) -> str:
    """The whole outcome in one plain sentence."""
    known = [f for f in findings.findings if f.effect != UNKNOWN]
    missing = [f for f in known if f.kind == "missing"]
    mistuned = [f for f in known if f.kind == "mistuned"]
    place = _open_places(findings)
    remains = f"at {place} something" if place else "something"
    if findings.verdict == "unexplained":
        at = f"At {place} recordings" if place else "Recordings"
        return f"{at} and simulation differ, and no known effect explains it."
    if findings.verdict == "partly_explained":
        causes = missing or mistuned
        names = capital(_causes(causes)) if causes else "Retuning"
        return f"{names} explain{'s' * (len(causes) < 2)} part of the difference; {remains} remains unexplained."
    if missing:
        off = f"; the simulation's value is off for {_causes(mistuned)}" if mistuned else ""
        return f"The difference is explained: {_causes(missing)}{off}."
    if mistuned:
        return f"Nothing is missing from the simulation; only its value is off for {_causes(mistuned)}."
    return "Simulation and recordings agree: what differs is noise and tuning within tolerance."
