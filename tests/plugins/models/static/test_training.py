"""``cellwatt train static`` and ``cellwatt predict``, as a person calls them."""

from __future__ import annotations

import json
import re
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import CellwattError
from cellwatt_plugins.models import read_metadata
from cellwatt_plugins.models.command import predict, train
from cellwatt_plugins.models.static import identify, paper
from cellwatt_plugins.models.static.training import Scores, half_width
from tests.calling import called
from tests.daemon.report.reading import check, numbers, read
from tests.plugins.models.making import undated
from tests.plugins.models.static import arms


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A collection, its robot, poses never collected, and what two trainings on it said."""
    folder = tmp_path_factory.mktemp("case")
    really = arms.Arm(friction=0.01 * arms.RATED, mass=arms.MASS * 1.1)
    robot, unseen = arms.write_case(folder, really, 4, count=48)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper, "TRIALS", 2)
        patch.setattr(identify, "FOLDS", 3)
        given = ("static", folder / "samples.parquet", "--robot", robot, "--out")
        report = json.loads(called(train, *given, folder / "a", "--json", "--report", folder / "page.html"))
        text = called(train, *given, folder / "b")
    return folder, unseen, report, text


@pytest.mark.slow
def test_the_page_has_the_pictures_and_the_numbers_of_the_report(case):
    folder, _, report, _ = case
    page = read(folder / "page.html")
    check(page)
    assert page.title == "mh12: torque to hold still"
    assert [text for tag, text in page.headings if tag == "h2"][:4] == [
        "Measured and predicted",
        "Residual of each joint",
        "Methods",
        "Effects that the CAD model lacks",
    ]
    assert len(page.figures) == 2
    assert [len(trace["x"]) for trace in page.figures[1]["data"]] == [48] * 6
    for row, method in zip(page.tables["Methods"][1:], report["methods"], strict=True):
        told = [numbers(cell)[0] for cell in row[2:]]
        assert told == pytest.approx([method[name] for name in ("rmse", "r2", "mape", "accuracy")], abs=0.006)
    figures = [figure for finding in report["findings"] for figure in finding["figures"]]
    for row, figure in zip(page.tables["Figures of the arm"][1:], figures, strict=True):
        assert numbers(row[3])[0] == pytest.approx(figure["value"], abs=figure["deviation"])
    assert str(folder / "samples.parquet") in [row[0] for row in page.tables["Files"]]
    assert ["page", str(folder / "page.html")] in page.tables["Settings"]


@pytest.mark.slow
def test_poses_never_collected_are_predicted(case, tmp_path):
    folder, (q, came, torque), report, _ = case
    assert [method["name"] for method in report["methods"]] == ["gravity", "network", "hybrid", "best"]
    columns = {f"q_{j + 1}": q[:, j] for j in range(6)} | {f"q_from_{j + 1}": came[:, j] for j in range(6)}
    pq.write_table(pa.table({"pose": np.arange(len(q)), **columns}), tmp_path / "poses.parquet")
    given = ("--model", folder / "a" / "model.onnx", tmp_path / "poses.parquet", "--out", tmp_path / "said.parquet")
    said = json.loads(called(predict, *given, "--json"))
    assert (said["rows"], said["missing"], said["begun"]) == (400, 0, 0)
    table = pq.read_table(tmp_path / "said.parquet")
    assert table.column_names[0] == "pose"
    total = np.abs(torque).sum(axis=1)
    assert Scores.of(total, table["torque_sum"].to_numpy()).r2 > 0.998
    assert np.abs(table["torque_2"].to_numpy() - torque[:, 1]).max() < 4.0
    inside = (table["torque_sum_low"].to_numpy() <= total) & (total <= table["torque_sum_high"].to_numpy())
    assert inside.mean() >= 0.9


def test_the_same_data_give_the_same_file(case):
    one, other = (case[0] / name / "model.onnx" for name in ("a", "b"))
    assert undated(one) == undated(other)
    assert read_metadata(one).training.rows == 48


def test_in_words(case):
    for part in (
        "gravity of the CAD model",
        "(0.687)",
        "best model",
        "Joint 2: friction holds",
        "is the scatter of a pose",
    ):
        assert part in case[3], case[3]
    assert "model.onnx" in case[3]
    best = case[2]["best"]
    assert best["scatter_nm"] == pytest.approx(min(np.linalg.norm(best["noise_nm"]), best["rmse"]))
    assert f"{best['scatter_nm']:.2f} Nm is the scatter" in case[3]


def test_a_missing_library_is_named(case, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    given = ("static", case[0] / "samples.parquet", "--robot", case[0] / "robot.yaml", "--out", tmp_path)
    with pytest.raises(CellwattError, match=r"training needs optuna: install it with pip install 'cellwatt\[train\]'"):
        called(train, *given)


def test_a_dozen_poses_in_newton_metres_are_a_beginning(tmp_path, monkeypatch):
    monkeypatch.setattr(paper, "TRIALS", 1)
    monkeypatch.setattr(identify, "FOLDS", 3)
    robot = arms.write_robot(tmp_path, arms.Arm())
    robot.write_text(re.sub(r"  (rated_torque|lower_limit|upper_limit).*\n", "", robot.read_text()))
    q = arms.within(arms.LIMITS, arms.halton(12))
    columns = {
        f"{name}_{j + 1}": values[:, j] for name, values in (("q", q), ("torque", arms.Arm().load(q))) for j in range(6)
    }
    pq.write_table(pa.table({"pose": np.arange(12), **columns}), tmp_path / "poses.parquet")
    text = called(train, "static", tmp_path / "poses.parquet", "--robot", robot, "--out", tmp_path)
    assert text.startswith("12 poses; ")


def test_scores_are_those_of_the_paper():
    measured, predicted = np.array([100.0, 200.0, 400.0]), np.array([110.0, 180.0, 400.0])
    scores = Scores.of(measured, predicted)
    assert scores.rmse == pytest.approx(np.sqrt(500 / 3))
    assert scores.mape == pytest.approx((10 + 10 + 0) / 3)
    assert scores.accuracy == pytest.approx(100 - 20 / 3)
    assert scores.mean_absolute == pytest.approx(10.0)
    assert scores.r2 == pytest.approx(1 - 500 / np.sum((measured - measured.mean()) ** 2))
    assert Scores.of(np.append(measured, 0.0), np.append(predicted, 5.0)).mape == pytest.approx(scores.mape)


def test_intervals_hold_what_they_say():
    rng = np.random.default_rng(0)
    inside = []
    for _ in range(300):
        errors = rng.standard_t(3, size=60)
        inside.append(np.mean(np.abs(rng.standard_t(3, size=200)) <= half_width(errors)))
    assert 0.89 < np.mean(inside) < 0.93
