"""Recordings beyond those that are looked at closely are compared with what was found in these."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellwatt_plugins.explain import api
from cellwatt_plugins.explain.explain import Explained
from cellwatt_plugins.explain.input import reading, selection
from cellwatt_plugins.explain.input.selection import FEW
from tests.plugins.explain import plant
from tests.plugins.explain.plant import Missing, column

SECONDS = 6.0


def offset(torque: np.ndarray) -> np.ndarray:
    return torque + np.array([0, 0, 1.5])


def pushed(t: np.ndarray, q: np.ndarray, qd: np.ndarray, run: str) -> np.ndarray:
    return column(25 * np.exp(-0.5 * ((t - 3) / 0.2) ** 2), 2)


def dying(torque: np.ndarray) -> np.ndarray:
    torque = offset(torque)
    torque[len(torque) // 2 :, 0] = np.nan
    return torque


OTHERS = {
    "same": (Missing(read=offset), "explained"),
    "pushed": (Missing(read=offset, added=pushed), "differs"),
    "silent": (Missing(read=lambda torque: offset(torque) * np.array([1, 1, np.nan])), "explained"),
    "dying": (Missing(read=dying), "explained"),
    "turned": (Missing(read=lambda torque: offset(torque) * np.array([1, -1, 1])), "not compared"),
}
"""Each repeats a motion of those that are looked at."""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Explained:
    folder = tmp_path_factory.mktemp("cell")
    plant.write_robot(folder)
    runs = [plant.record(f"run_{seed}", seed, Missing(read=offset), SECONDS) for seed in range(FEW)]
    runs += [plant.record(name, seed, missing, SECONDS) for seed, (name, (missing, _)) in enumerate(OTHERS.items())]
    for run in runs:
        plant.write(folder, run)
    kinds = ("recording", "simulation")
    recordings, simulations = ([folder / f"{run.name}.{kind}.parquet" for run in runs] for kind in kinds)
    with pytest.MonkeyPatch.context() as patch:
        for module in (reading, selection):
            patch.setattr(module, "SAMPLES", FEW * SECONDS * plant.RATE)
        return api.explain(recordings, robot=folder, simulation=simulations, seconds=1e6)


@pytest.mark.parametrize("name", OTHERS)
def test_each_other_recording_is_judged(found: Explained, name: str) -> None:
    (other,) = [other for other in found.findings.others if other.recording == name]
    said = {True: "explained", False: "differs", None: "not compared"}
    assert said[other.explained] == OTHERS[name][1]
    assert np.isfinite(other.error)


def test_the_odd_ones_are_named_with_the_reason(found: Explained) -> None:
    findings = found.findings
    assert findings.verdict == "partly_explained"
    notes = "\n".join(findings.notes)
    assert "6 of 11 recordings, those whose motions differ most, were looked at closely; " in notes
    assert "; 1 of the others differs from the findings" in notes
    (pushed,) = [other for other in findings.others if other.explained is False]
    assert pushed.channel == "tau_2"
    truth = 25 * np.sqrt(np.sqrt(np.pi) * 0.2 / SECONDS)
    assert pushed.error == pytest.approx(truth, rel=0.1)
    assert f"pushed: tau_2 is off by {pushed.error:.3g} Nm rms" in notes
    assert "turned was not compared: turned: torque of joint 2 has the opposite sign" in notes


def test_the_report_lists_them(found: Explained, tmp_path: Path) -> None:
    found.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    section = page[page.index("<h2>Other recordings</h2>") :]
    assert "6 recordings (" in page
    assert "5 more compared with the model" in page
    order = [section.index(f">{name}<") for name in ("turned", "pushed", "same")]
    assert order == sorted(order)
