"""The page of ``explain``: what it holds, that it is safe to open, small, and survives gaps."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellwatt.report import Provenance
from cellwatt_plugins.mismatch.report import Trace, report
from cellwatt_plugins.mismatch.report.heat import by_coordinate, by_time, rms_by_cell
from cellwatt_plugins.mismatch.report.trace import telling_stretch, worst_first
from cellwatt_plugins.mismatch.verdict.findings import Findings, Span, Where
from tests.daemon.report.reading import Page, check, numbers
from tests.plugins.mismatch import reported

FIVE_MB = 5_000_000


def page(folder: Path, findings: Findings, traces: list[Trace], robot: str = "MH12", floors: Any = None) -> str:
    floors = reported.floors(traces[0]) if floors is None else floors
    report(findings, traces, robot, floors, Provenance.here()).write(folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def arms_page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of the six joints, made once for all that only read it."""
    return page(tmp_path_factory.mktemp("arm"), *reported.arm())


@pytest.fixture(scope="module")
def single_page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The same of one joint."""
    return page(tmp_path_factory.mktemp("single"), *reported.single())


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
    assert html.index("Joint 3 needs up to") < html.index("Where the mismatch sits") < html.index("What was tried")


def test_page_is_one_of_the_report_pages(arms_page: str) -> None:
    read = Page(arms_page)
    check(read)
    assert read.title == "MH12: simulation and recordings"
    assert [text for tag, text in read.headings if tag == "h2"] == [
        "Your simulation in numbers",
        "What takes the error away",
        "What was found",
        "Channels",
        "Where the mismatch sits",
        "Measured, simulation and model over time",
        "What the difference follows",
        "What was tried",
        "What the data could not tell",
    ]


def test_table_of_channels_has_the_numbers_of_the_findings(arms_page: str) -> None:
    rows = Page(arms_page).tables["Error of each channel"][1:]
    fit = reported.arm()[0].fit
    assert len(rows) == len(fit)
    for row, channel in zip(rows, fit, strict=True):
        told = [numbers(cell)[0] for cell in row[1:5]]
        true = [channel.simulation, channel.refit, channel.model, channel.noise_floor]
        assert told == pytest.approx(true, abs=0.05 * channel.noise_floor)


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


def test_numbers_found_and_retuned_stand_in_one_table(arms_page: str) -> None:
    rows = {row[0]: row[1:3] for row in Page(arms_page).tables["Numbers"][1:]}
    assert rows["Mass of link 3"] == ["2.10 kg", "2.34 ± 0.03 kg"]
    assert rows["Stribeck friction (joint 2): excess"] == ["not in it", "4.12 ± 0.19 N·m"]
    assert rows["Rotor inertia (joint 1)"] == ["0.150 kg·m²", "0.1631 ± 0.0004 kg·m²"]


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


def test_channels_of_findings_are_open_and_the_others_folded(arms_page: str) -> None:
    channels = re.findall(r"<details( open)?><summary>([^<]*)</summary><figure", arms_page)
    opened = [name for state, name in channels if state]
    assert opened == ["Joint 2 torque", "Supply power", "Joint 3 torque", "Joint 1 torque"]
    assert [name for state, name in channels if not state] == ["Joint 4 torque", "Joint 5 torque", "Joint 6 torque"]


def test_figures_are_the_three_states_each_channel_and_run_and_the_clouds(arms_page: str) -> None:
    html = arms_page
    assert re.findall(r"data-state=(\d)( hidden)?", html) == [
        ("0", ""),
        ("1", " hidden"),
        ("2", " hidden"),
    ]
    assert len(figures(html)) == 3 + 2 * 7 + 4


def test_agreement_is_said_and_no_finding_drawn(tmp_path: Path) -> None:
    html = page(tmp_path, *reported.agreement())
    assert "Simulation and recordings agree" in html
    assert "What was found" not in html
    assert "What the difference follows" not in html


def test_one_joint_without_power(single_page: str) -> None:
    html = single_page
    assert "At joint 1 recordings and simulation differ, and no known effect explains it." in html
    assert "An effect that is not in the library (joint 1)" in html
    assert "Supply power" not in html
    assert "beyond the noise is gone" not in html


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
    drawn = json.dumps(figures(html))
    assert "&lt;a href" in drawn
    assert "<a " not in drawn


def test_long_recordings_stay_below_five_megabytes(tmp_path: Path) -> None:
    findings, _ = reported.arm()
    traces = [reported.trace(f"run_{i}", i, 45_000, 7) for i in range(4)]
    html = page(tmp_path, findings, traces)
    assert len(html.encode()) < FIVE_MB


def test_many_recordings_are_drawn_in_part_and_said_so(tmp_path: Path) -> None:
    traces = [reported.trace(f"run_{i}", i, 500, 2, effects=i > 4) for i in range(9)]
    html = page(tmp_path, replace(reported.arm()[0], fit=reported.fit(traces)), traces)
    assert "These are the 6 that differ most of 9." in html
    assert "(run_0, run_1, run_2, run_3, run_4, run_5 and 3 more)" in html
    assert [t.name for t in worst_first(traces, {"tau_2": 0.6}, 4)] == ["run_5", "run_6", "run_7", "run_8"]


def test_gaps_and_unknown_floors_leave_holes_and_no_failure(tmp_path: Path) -> None:
    findings, traces = reported.arm()
    measured, model = traces[0].measured.copy(), traces[0].model.copy()
    measured[100:900] = np.nan
    measured[:, 3] = np.nan
    model[2000:2100] = np.inf
    velocity = traces[0].velocity.copy()
    velocity[:50] = np.nan
    velocity[:, 4] = np.nan
    holed = replace(traces[0], measured=measured, model=model, velocity=velocity, held_out=None)
    floors = reported.floors(holed)
    floors[0], floors[6] = np.nan, 0.0
    fit = (replace(findings.fit[0], refit=np.nan, noise_floor=np.nan), *findings.fit[1:])
    broken = replace(findings.findings[0], confidence=np.nan)
    html = page(tmp_path, replace(findings, fit=fit, findings=(broken,)), [holed, traces[1]], floors=floors)
    assert "confidence not stated" in html
    assert not re.search(r"\b(nan|inf)\b", re.sub(r"<script.*?</script>", "", html), re.IGNORECASE)
    assert len(figures(html)) == 3 + 2 * 7 + 2


@pytest.mark.parametrize("count", [0, 1, 2])
def test_hardly_any_samples(tmp_path: Path, count: int) -> None:
    findings, _ = reported.arm()
    html = page(tmp_path, findings, [reported.trace(count=count, joints=2)])
    assert "What was found" in html


def test_nothing_to_draw_leaves_the_words(tmp_path: Path) -> None:
    html = report(reported.arm()[0], [], "MH12", np.zeros(0), Provenance.here()).html()
    assert "Stribeck friction (joint 2)" in html
    assert figures(html) == []


def test_recordings_may_lack_channels_of_the_first(tmp_path: Path) -> None:
    findings, traces = reported.arm()
    html = page(tmp_path, findings, [traces[0], reported.trace("run_02", 2, 3000, power=False)])
    assert len(figures(html)) == 3 + 7 + 6 + 4


def test_shapes_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    one = reported.single()[1][0]
    with pytest.raises(ValueError, match=r"bench: refit is \(4000, 2\), expected \(4000, 1\)"):
        replace(one, refit=np.zeros((4000, 2)))
    with pytest.raises(ValueError, match="position and velocity"):
        replace(one, velocity=one.velocity[:-1])
    with pytest.raises(ValueError, match="2 noise floors for 1 channels"):
        page(tmp_path, *reported.single(), floors=np.ones(2))


def test_opens_where_the_simulation_is_furthest_off() -> None:
    one = reported.single()[1][0]
    measured = one.simulation.copy()
    measured[2500:2600] += 5.0
    start, end = telling_stretch(replace(one, measured=measured), "tau_1", 4.0)
    assert start <= 20.0
    assert end >= 20.8
    assert end - start == pytest.approx(4.0)


def test_rms_by_cell_against_the_definition() -> None:
    random = np.random.default_rng(3)
    residual, cell = random.normal(size=3000), random.integers(-1, 6, 3000).astype(np.float64)
    residual[::7] = np.nan
    rms = rms_by_cell(residual, cell, 5)
    for k in range(5):
        mine = residual[(cell == k) & np.isfinite(residual)]
        assert rms[k] == pytest.approx(np.sqrt((mine**2).mean()))
    assert np.isnan(rms_by_cell(residual[:20], np.zeros(20), 1)).all()


def test_strips_show_the_effect_where_it_was_put() -> None:
    traces = reported.arm()[1]
    floors = dict(zip(traces[0].channels, reported.floors(traces[0]), strict=True))
    velocity = by_coordinate(traces, "simulation", floors, "velocity")
    slow = np.abs(velocity.places) < np.sqrt(0.13)
    assert np.nanmax(velocity.ratio[1, slow]) > 4
    assert np.nanmax(velocity.ratio[1, np.abs(velocity.places) > np.sqrt(0.5)]) < 1.5
    assert np.nanmax(by_coordinate(traces, "model", floors, "velocity").ratio[1]) < 1.5
    position = by_coordinate(traces, "model", floors, "position")
    assert position.places[np.nanargmax(position.ratio[2])] == pytest.approx(0.7, abs=0.15)
    time, middles = by_time(traces, "simulation", floors)
    assert [name for _, name in middles] == ["run_01", "run_02"]
    assert np.nanmedian(time.ratio[6]) == pytest.approx(85 / 4, rel=0.05)


def test_curve_through_the_cloud_is_what_the_model_adds(arms_page: str) -> None:
    cloud = next(f for f in figures(arms_page) if "velocity of joint 2" in json.dumps(f, ensure_ascii=False))
    curve = next(t for t in cloud["data"] if t["name"] == "what the model adds")
    points = [(x, y) for x, y in zip(curve["x"], curve["y"], strict=True) if y is not None and abs(x) > 0.03]
    assert len(points) > 20
    for x, y in points:
        assert y == pytest.approx(0.98 * 4.1 * np.exp(-((x / 0.13) ** 2)) * np.sign(x), abs=0.35)
