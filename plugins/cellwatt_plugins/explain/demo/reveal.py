"""The concealed physics beside the answer of ``explain``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from cellwatt.report.numbers import measured, number, unit
from cellwatt_plugins.explain.demo.physics import Concealed

FAR = 3.0
"""Standard deviations by which a number may be off."""


@dataclass(frozen=True)
class Named:
    """One concealed piece of physics with the finding that names it; None if no finding does."""

    concealed: Concealed
    finding: Mapping[str, Any] | None


@dataclass(frozen=True)
class Revealed:
    """The truth beside ``findings.json``."""

    answers: tuple[Named, ...]
    invented: tuple[Mapping[str, Any], ...]
    """Findings of physics that was not concealed."""

    @property
    def right(self) -> bool:
        """True if everything concealed is named at its joint, and nothing else is named."""
        return not self.invented and all(answer.finding is not None for answer in self.answers)

    @property
    def exact(self) -> bool:
        """True if each number of the named physics is within ``FAR``."""
        known = [
            (a.finding, name, n) for a in self.answers if a.finding for name, (n, _) in a.concealed.numbers.items()
        ]
        return all(_off(finding, name, number) <= FAR for finding, name, number in known)

    def as_json(self) -> dict[str, Any]:
        """The truth beside the answer, JSON-ready."""
        return {"right": self.right, "exact": self.exact, **asdict(self)}


def compared(concealed: Sequence[Concealed], findings: Mapping[str, Any]) -> Revealed:
    """Match the concealed physics with the content of ``findings.json`` by name and joint."""
    named = {(f["effect"], f["joint"]): f for f in (*_retuned(findings), *findings["findings"])}
    answers = tuple(Named(c, named.get((c.effect, None if c.joint is None else c.joint + 1))) for c in concealed)
    used = [answer.finding for answer in answers]
    return Revealed(answers, tuple(f for f in findings["findings"] if f not in used))


def _retuned(findings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Numbers that are off beyond their tolerance, in the shape of a finding."""
    return [
        {**moved, "effect": moved["parameter"], "parameters": {"now": {"value": moved["now"], "std": moved["std"]}}}
        for moved in findings["retuned"]
        if moved["beyond"]
    ]


def in_words(revealed: Revealed) -> str:
    """A line for each concealed number and for each false finding."""
    lines = ["What was concealed:"]
    for answer in revealed.answers:
        if answer.finding is None:
            lines.append(f"  {answer.concealed.sentence}.  WRONG: explain does not name it")
            continue
        lines.append(f"  {answer.concealed.sentence}.")
        for name, (value, symbol) in answer.concealed.numbers.items():
            found, std = _found(answer.finding, name)
            off = _off(answer.finding, name, value)
            sign = "right" if off <= FAR else f"named, {off:.0f} σ off"
            true, stated = (f"{text} {unit(symbol)}".strip() for text in (number(value), measured(found, std)))
            lines.append(f"    {name}: {true}; explain says {stated}: {sign}")
    lines += [f"  Not concealed: {finding['statement']}  WRONG" for finding in revealed.invented]
    return "\n".join(lines if len(lines) > 1 else [*lines, "  Nothing: only numbers are off, by a few per cent."])


def _off(finding: Mapping[str, Any], name: str, value: float) -> float:
    """Distance of a number from the true ``value``, in its standard deviations."""
    found, std = _found(finding, name)
    return abs(found - value) / std if std > 0 else 0.0


def _found(finding: Mapping[str, Any], name: str) -> tuple[float, float]:
    """A number of a finding and its standard deviation; ``now``: the number on the arm."""
    parameters = finding["parameters"]
    if name in parameters:
        return parameters[name]["value"], parameters[name]["std"]
    first = next(iter(parameters.values()))
    return (finding["was"] or 0.0) + first["value"], first["std"]
