"""Findings in plain words: rounding, names, the verdict's sentence."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cellwatt_plugins.mismatch.report import wording
from cellwatt_plugins.mismatch.verdict.findings import Findings, UnexplainedChannel
from tests.plugins.mismatch.reported import HEAVIER, INERTIA, STANDBY, STRIBECK


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (1.0, "near certain, >99 %"),
        (0.97, "very likely, 97 %"),
        (0.5, "more likely than not, 50 %"),
    ],
)
def test_confidence_in_words(share: float, text: str) -> None:
    assert wording.confidence(share) == text


def test_names_as_people_write_them() -> None:
    assert wording.effect_name("load_dependent_friction") == "load-dependent friction"
    assert wording.effect_name("coulomb_friction") == "Coulomb friction"
    assert wording.channel_name("tau_3") == "joint 3 torque"


REST = UnexplainedChannel("power", 9.0, 4.0, "The supply differs.")
LATE = UnexplainedChannel("tau_5", 9.0, 4.0, "The time was up.", looked_at=False)
UNKNOWN = replace(STRIBECK, effect="unknown", joint=3)


@pytest.mark.parametrize(
    ("findings", "sentence"),
    [
        (
            Findings("no_mismatch", ()),
            "Simulation and recordings agree: what differs is noise and tuning within tolerance.",
        ),
        (
            Findings("no_mismatch", (), retuned=(HEAVIER,)),
            "No physics is missing from the simulation; numbers of it are off, and these explain the difference.",
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
            Findings("partly_explained", (STANDBY,), (REST, LATE)),
            "Standby power explains part of the difference; at the supply something remains unexplained; joint 5 was "
            "not looked at in full: the time was up.",
        ),
        (
            Findings("unexplained", (), (REST,)),
            "At the supply recordings and simulation differ, and no known effect explains it.",
        ),
    ],
)
def test_verdict_in_one_sentence(findings: Findings, sentence: str) -> None:
    assert wording.verdict(findings) == sentence
