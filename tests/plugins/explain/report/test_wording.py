"""Findings in plain words: rounding, names, the verdict's sentence."""

from __future__ import annotations

import pytest

from cellwatt_plugins.explain.report import wording
from cellwatt_plugins.explain.verdict.findings import ChannelFit, Findings, UnexplainedChannel
from tests.plugins.explain.reported import HEAVIER, INERTIA, STANDBY, STRIBECK

REST = UnexplainedChannel("power", 9.0, 4.0, "The supply differs.")
LATE = UnexplainedChannel("tau_5", 9.0, 4.0, "The time was up.", looked_at=False)


@pytest.mark.parametrize(
    ("findings", "sentence"),
    [
        (
            Findings("no_mismatch", ()),
            "No torque was compared: no joint whose torque was recorded moved far enough.",
        ),
        (
            Findings("no_mismatch", (), fit=(ChannelFit("power", "W", 2.0, 2.0, 2.0, 2.0),)),
            "No torque was compared: no joint whose torque was recorded moved far enough; the supply's power agrees.",
        ),
        (
            Findings("no_mismatch", (), retuned=(HEAVIER,)),
            "No physics is missing from the simulation; some of its numbers are off: they explain the difference.",
        ),
        (
            Findings("explained", (STRIBECK, STANDBY, INERTIA)),
            "The difference is explained: Stribeck friction (joint 2) and standby power; the simulation's value is off "
            "for rotor inertia (joint 1).",
        ),
        (
            Findings("partly_explained", (STANDBY,), (REST, LATE)),
            "Standby power explains part of the difference; at the supply something remains unexplained; joint 5 was "
            "not looked at in full: the time limit was reached.",
        ),
    ],
)
def test_verdict_in_one_sentence(findings: Findings, sentence: str) -> None:
    assert wording.verdict(findings) == sentence
