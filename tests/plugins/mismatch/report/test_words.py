"""Findings in plain words: rounding, names, the verdict's sentence."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cellwatt_plugins.mismatch.report import words
from cellwatt_plugins.mismatch.verdict.findings import Findings, UnexplainedChannel
from tests.plugins.mismatch.reported import INERTIA, STANDBY, STRIBECK


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (4.1234, 0.2, "4.1 ± 0.2"),
        (4.1234, 0.187, "4.12 ± 0.19"),
        (0.1312, 0.0123, "0.131 ± 0.012"),
        (-12.6, 3.0, "−13 ± 3"),
        (1234.0, 56.0, "1230 ± 60"),
        (1234567.0, 8000.0, "(1.235 ± 0.008)·10⁶"),
        (2.352e-5, 3e-7, "(2.35 ± 0.03)·10⁻⁵"),
        (0.01, 3.0, "0 ± 3"),
        (0.0, 0.02, "0.00 ± 0.02"),
        (9.97, 0.0996, "9.97 ± 0.10"),
        (3.14159, 0.0, "3.14"),
        (3.14159, float("nan"), "3.14"),
        (float("nan"), 0.1, "–"),
        (0.0, 0.0, "0"),
    ],
)
def test_numbers_are_rounded_to_their_uncertainty(value: float, std: float, text: str) -> None:
    assert words.measured(value, std) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (1.0, "near certain, >99 %"),
        (0.99, "near certain, 99 %"),
        (0.97, "very likely, 97 %"),
        (0.9499, "likely, 94 %"),
        (0.5, "more likely than not, 50 %"),
        (0.2, "a guess, 20 %"),
    ],
)
def test_confidence_in_words(share: float, text: str) -> None:
    assert words.confidence(share) == text


def test_units_and_names_as_people_write_them() -> None:
    assert words.unit("kg*m^2") == "kg·m²"
    assert words.unit("N*m*s/rad") == "N·m·s/rad"
    assert words.effect_name("load_dependent_friction") == "load-dependent friction"
    assert words.effect_name("coulomb_friction") == "Coulomb friction"
    assert words.channel_name("tau_3") == "joint 3 torque"
    assert words.listed(["a", "b", "c"]) == "a, b and c"
    assert words.listed([]) == ""
    assert words.times(3.14) == "3.1×"
    assert words.times(9.97) == "10×"


REST = UnexplainedChannel("power", 9.0, 4.0, "The supply differs.")
UNKNOWN = replace(STRIBECK, effect="unknown", joint=3)


@pytest.mark.parametrize(
    ("findings", "sentence"),
    [
        (
            Findings("no_mismatch", ()),
            "Simulation and recordings agree: what differs is noise and tuning within tolerance.",
        ),
        (
            Findings("no_mismatch", (INERTIA,)),
            "Nothing is missing from the simulation; only its value is off for rotor inertia (joint 1).",
        ),
        (
            Findings("explained", (STRIBECK, STANDBY, INERTIA)),
            "The difference is explained: Stribeck friction (joint 2) and standby power; the simulation's value is off "
            "for rotor inertia (joint 1).",
        ),
        (
            Findings("explained", (STRIBECK,) * 5),
            "The difference is explained: Stribeck friction (joint 2), Stribeck friction (joint 2), "
            "Stribeck friction (joint 2) and 2 more.",
        ),
        (
            Findings("partly_explained", (STANDBY, UNKNOWN), (REST,)),
            "Standby power explains part of the difference; at joint 3 and the supply something remains unexplained.",
        ),
        (
            Findings("partly_explained", (UNKNOWN,)),
            "Retuning explains part of the difference; at joint 3 something remains unexplained.",
        ),
        (
            Findings("unexplained", (), (REST,)),
            "At the supply recordings and simulation differ, and no known effect explains it.",
        ),
    ],
)
def test_verdict_in_one_sentence(findings: Findings, sentence: str) -> None:
    assert words.verdict(findings) == sentence
