"""The page of ``explain``: what it holds, that it is safe to open, small, and survives gaps."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellwatt.report import Folded, Provenance
from cellwatt_plugins.explain.input.driven import drive_of
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.report.motion import section
from cellwatt_plugins.explain.report.page import report
from cellwatt_plugins.explain.report.trace import Trace, worst_first
from cellwatt_plugins.explain.simulators import load_simulator
from cellwatt_plugins.explain.verdict.findings import Findings, Span, Where
from cellwatt_plugins.robot.servo.law import servo_of
from tests.daemon.report.reading import Page, check, numbers
from tests.plugins.explain import reported

FIVE_MB = 5_000_000


def page(folder: Path, findings: Findings, traces: list[Trace], robot: str = "MH12") -> str:
    report(findings, traces, robot, reported.floors(traces[0]), Provenance.here()).write(folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def arms_page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of the six joints, made once for all that only read it."""
    return page(tmp_path_factory.mktemp("arm"), *reported.arm())


def figures(html: str) -> list[dict[str, Any]]:
    """All drawn figures as a browser would read them."""
    return Page(html).figures


def test_page_tells_everything_that_was_found(arms_page: str) -> None:
    html = arms_page
    told = [
        "Stribeck friction (joint 2) and standby power explain part of the difference; at joint 3 something remains",
        "4.12 ± 0.19</b> N·m",
        "84.6 ± 0.4</b> W",
        "very likely, 97 %",
        "near certain, &gt;99 %",
        "at −0.30 to 0.30 rad/s; in run_01 3.1 to 4.0 s, run_01 6.2 to 6.9 s and 1 more",
        "98 % of the error beyond the noise is gone.",
        "Load-dependent friction (joint 2)</b>: same sign and speed range; run a slow sweep at two loads",
        "at 0.50 to 0.90 rad (29 to 52°)",
        "helps in 3 of 6 blocks left out only",
        "no joint warms by more than 2 K in 100 s.",
        "2 recordings (run_01, run_02) · 100 s · 125 Hz",
    ]
    assert [t for t in told if t not in html] == []
    places = [html.index(t) for t in ("Joint 3 needs up to", "Measured, simulation and model", "What was tried")]
    assert places == sorted(places)


def test_cascade_comes_first_and_tells_each_channel_after_each_step(arms_page: str) -> None:
    findings = reported.arm()[0]
    assert arms_page.index("What takes the error away") < arms_page.index("What was found")
    bars = re.findall(r"<span>([^<]*)</span><div class=track>.*?<span class=value>([0-9.]*) × noise", arms_page)
    assert [(name, float(value)) for name, value in bars[:3]] == [
        ("Your simulation", 8.4),
        ("+ Stribeck friction of joint 2", 8.1),
        ("+ your numbers retuned", 1.2),
    ]
    rows = Page(arms_page).tables["Error of each channel after each step"][1:]
    for row, step in zip(rows, findings.cascade, strict=False):
        told = [numbers(cell)[0] for cell in row[1:]]
        floors = [f.noise_floor for f in findings.fit]
        for value, true, floor in zip(told, step.channels.values(), floors, strict=True):
            assert value == pytest.approx(true, abs=0.05 * floor)


def test_linear_axis_is_told_in_metres(tmp_path: Path) -> None:
    findings, traces = reported.single()
    (unknown,) = findings.findings
    linear = replace(unknown, statement="Something.", improvement=replace(unknown.improvement, unit="N"))
    fit = tuple(replace(f, unit="N") for f in findings.fit)
    html = page(tmp_path, replace(findings, findings=(linear,), fit=fit), [replace(t, units=("N",)) for t in traces])
    assert "at 0.00 to 0.60 m" in html
    assert not re.search(r"\brad\b", re.sub(r"<script.*?</script>|<style.*?</style>", "", html, flags=re.DOTALL))
    drawn = json.dumps(figures(html))
    assert "position of joint 1, m" in drawn
    assert not re.search(r"\brad\b", drawn)


def test_a_linear_drive_is_off_by_metres(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "lift.xml").write_text(
        '<mujoco><worldbody><body><joint name="lift" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>'
        '</worldbody><actuator><position joint="lift" kp="900" kv="60"/></actuator></mujoco>'
    )
    simulator, servo = load_simulator(tmp_path / "lift.xml", ["lift"]), servo_of(tmp_path / "lift.xml", ["lift"])
    time = np.arange(300) * 0.01
    position = 0.05 * np.sin(time)[:, None]
    assert servo is not None
    drive = drive_of(servo, position, position, 0.01)
    told = Run("run_01", time, position, None, np.zeros((300, 1)), command=position, drive=drive)
    (joint,) = (b for b in section([told], simulator, None).blocks if isinstance(b, Folded))
    assert re.fullmatch(r"Joint 1: off by [0-9.e-]+ m rms", joint.title)


def test_agreement_is_said_and_no_finding_drawn(tmp_path: Path) -> None:
    html = page(tmp_path, *reported.agreement())
    check(Page(html))
    assert "Simulation and recordings agree" in html
    assert "What was found" not in html
    assert "What the difference follows" not in html


def test_foreign_text_is_never_markup(tmp_path: Path) -> None:
    findings, traces = reported.arm()
    bad = "<script>alert('x')</script><a href=x>\"&"
    first = findings.findings[0]
    nasty = replace(
        first,
        effect=bad,
        statement=bad,
        parameters={bad: replace(first.parameters["excess"], unit=bad)},
        where=Where(("tau_2", bad), times=(Span(bad, 0.0, 1.0),)),
        improvement=replace(first.improvement, unit=bad),
        alternatives=(replace(first.alternatives[0], effect=bad, why=bad),),
    )
    findings = replace(
        findings,
        findings=(nasty,),
        unexplained=(replace(findings.unexplained[0], statement=bad),),
        fit=(replace(findings.fit[0], unit=bad, channel=bad),),
        tried=(replace(findings.tried[0], effect=bad, why=bad),),
        notes=(bad,),
    )
    html = page(tmp_path, findings, [replace(t, name=bad) for t in traces], robot=bad)
    assert "<script>alert" not in html.lower()
    assert "<a " not in html
    assert "<a " not in json.dumps(figures(html))


def test_long_recordings_stay_below_five_megabytes(tmp_path: Path) -> None:
    findings, _ = reported.arm()
    traces = [reported.trace(f"run_{i}", i, 45_000, 7) for i in range(4)]
    html = page(tmp_path, findings, traces)
    assert len(html.encode()) < FIVE_MB


def test_many_recordings_are_drawn_in_part_and_said_so(tmp_path: Path) -> None:
    traces = [reported.trace(f"run_{i}", i, 500, 2, effects=i > 4) for i in range(9)]
    html = page(tmp_path, replace(reported.arm()[0], fit=reported.fit(traces)), traces)
    assert "Shown: the 6 of 9 that differ most." in html
    assert "(run_0, run_1, run_2, run_3, run_4, run_5 and 3 more)" in html
    assert [t.name for t in worst_first(traces, {"tau_2": 0.6}, 4)] == ["run_5", "run_6", "run_7", "run_8"]


def test_gaps_leave_holes_and_no_failure(tmp_path: Path) -> None:
    findings, traces = reported.arm()
    measured, model = traces[0].measured.copy(), traces[0].model.copy()
    measured[100:900] = np.nan
    measured[:, 3] = np.nan
    model[2000:2100] = np.inf
    velocity = traces[0].velocity.copy()
    velocity[:50] = np.nan
    velocity[:, 4] = np.nan
    holed = replace(traces[0], measured=measured, model=model, velocity=velocity)
    html = page(tmp_path, findings, [holed, traces[1]])
    assert not re.search(r"\b(nan|inf)\b", re.sub(r"<script.*?</script>", "", html), re.IGNORECASE)
    assert len(figures(html)) == 2 * 7 + 4


def test_curve_through_the_cloud_is_what_the_model_adds(arms_page: str) -> None:
    cloud = next(f for f in figures(arms_page) if "velocity of joint 2" in json.dumps(f, ensure_ascii=False))
    curve = next(t for t in cloud["data"] if t["name"] == "what the model adds")
    points = [(x, y) for x, y in zip(curve["x"], curve["y"], strict=True) if y is not None and abs(x) > 0.03]
    assert len(points) > 20
    for x, y in points:
        assert y == pytest.approx(0.98 * 4.1 * np.exp(-((x / 0.13) ** 2)) * np.sign(x), abs=0.35)
