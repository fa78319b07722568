"""Rows of the UR10e's files that are damaged, and figures as they stand on a page."""

import numpy as np
from real import ur10e
from real.page import markdown
from real.pictures import masses, over_floor


def rows(count: int) -> list[str]:
    return [",".join(f"{value:.4f}" for value in [500 + 0.01 * i, *np.full(30, 0.1)]) for i in range(count)]


def test_damaged_rows_are_dropped_and_counted(tmp_path):
    lines = rows(20)
    lines[5] = lines[5].rsplit(",", 10)[0]
    lines[7] = lines[7].replace("0.1000", "1e250", 1)
    lines[9] = lines[9].replace("0.1000", "0.1.0", 1)
    lines[11] = lines[3]
    (tmp_path / ur10e.FOLDER).mkdir()
    (tmp_path / ur10e.FOLDER / "some.csv").write_text("\n".join(lines))
    recording = ur10e.read(tmp_path, "some")
    assert (recording.dropped, len(recording.time)) == (4, 16)
    assert recording.time[0] == 0.0
    assert np.all(np.diff(recording.time) > 0)


FIT = {"channel": "tau_1", "unit": "N*m", "simulation": 3.0, "refit": 2.0, "model": 1.1, "noise_floor": 1.0}
FOUND = {"effect": "payload", "joint": None, "kind": "missing", "statement": "A payload is missing.",
         "improvement": {"channel": "tau_1", "before": 2.0, "after": 1.1}, "alternatives": ["torque_gain"]}  # fmt: skip
TOLD = {"verdict": "explained", "findings": [FOUND], "unexplained": [], "fit": [FIT], "model_over_floor": [1.1],
        "payload": {"mass": 3.1, "interval": [2.5, 3.7], "error_percent": 10.5}}  # fmt: skip
STORY = {"true_mass": 2.8, "plain_fit": {"published": 3.08}, "published/some": TOLD}


def test_tables_hold_masses_findings_and_errors():
    page = markdown({"payload": STORY, "lwr": {"skipped": "no recordings"}})
    assert "| explain, published gains, some | 3.100 | 2.50 – 3.70 | +10.5 % |" in page
    assert "| A payload is missing. | missing | tau_1 | 2 → 1.1 | torque_gain |" in page
    assert "| tau_1 | 3 | 2 | 1.1 | 1 | 1.10 |" in page
    assert page.endswith("## lwr\n\nno recordings")


def test_pictures_show_intervals_and_errors_over_the_floor():
    dots = masses(STORY)["data"][0]
    assert dots["x"] == [3.1, 3.08]
    assert np.allclose(dots["error_x"]["array"], [0.6, 0.0])
    bars = over_floor({"arm": TOLD})["data"]
    assert [bar["y"] for bar in bars] == [[3.0], [1.1]]
