"""``cellwatt train power`` as a user calls it."""

from __future__ import annotations

import json

import pyarrow.parquet as pq
import pytest

from cellwatt.errors import CellwattError
from cellwatt_plugins.models.command import predict, train
from cellwatt_plugins.models.power import scg_network
from tests.calling import called
from tests.daemon.report.reading import check, numbers, read
from tests.plugins.models.power.emulated_arm import write_case

POWER = train, "power"
RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return write_case(tmp_path_factory.mktemp("case"), "six axes", 3, moves=3, unseen=2)


def check_page(page, report):
    check(page)
    assert len(page.figures) == 4  # three moves, residuals
    for row in page.tables["Moves held out"][1:]:
        told = report["held_out"][row[0]]
        scores = [told[name] for name in ("energy_error_mean_percent", "energy_error_worst_percent", "power_rmse_watt")]
        assert [numbers(cell)[0] for cell in row[1:4]] == pytest.approx(scores, abs=0.006)
        currents = [100 * share for share in told["current_relative_rmse"]]
        assert [numbers(cell)[0] for cell in row[4:]] == pytest.approx(currents, abs=0.06)
    parameters = report["best"]["parameters"]
    for name, *cells in page.tables["Torque"][1:]:
        for cell, value in zip(cells, parameters[name], strict=True):
            shown, *unsure = numbers(cell.split(")·")[0])[:2]
            assert unsure, f"{name} has no uncertainty"
            scale = 10.0 ** int(cell.split("·10")[1].translate(RAISED)) if "·10" in cell else 1.0
            assert value == pytest.approx(scale * shown, abs=scale * unsure[0] + 1e-5)
    standby = numbers(page.tables["Supply"][1][1])
    assert standby[0] == pytest.approx(parameters["standby_watt"], abs=standby[1])


@pytest.mark.slow
@pytest.mark.timeout(300)  # 20 s of an idle core
def test_a_model_its_report_and_its_predictions(case, tmp_path, monkeypatch):
    monkeypatch.setattr(scg_network, "ITERATIONS", 10)
    robot, table, unseen = case
    page = tmp_path / "page.html"
    report = json.loads(called(*POWER, table, "--robot", robot, "--out", tmp_path, "--json", "--report", page))
    check_page(read(page), report)
    assert report == json.loads((tmp_path / "power.json").read_text())
    assert set(report["held_out"]) == {"NLS", "SCG", "best"}
    assert report["held_out"]["best"]["energy_error_mean_percent"] < 5
    assert len(report["held_out"]["best"]["energy_error_percent"]) == 3
    assert report["nls"]["power"]["P_c"][0] == pytest.approx(80, rel=0.1)
    assert report["held_out"]["NLS"]["energy_error_mean_percent"] < 8
    called(predict, "--model", tmp_path / "model.onnx", unseen, "--out", tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")
    assert said.column_names == ["t", "move", "power", *(f"current_{i}" for i in range(1, 7))]
    assert said.num_rows == pq.read_table(unseen).num_rows


def test_a_robot_without_torque_constants_is_refused(case, tmp_path):
    robot, table, _ = case
    text = robot.read_text().replace("torque_constant: 13.0", "torque_constant: 0.0")
    assert text != robot.read_text()
    (tmp_path / "robot.yaml").write_text(text)
    (tmp_path / "robot.urdf").write_text((robot.parent / "robot.urdf").read_text())
    with pytest.raises(CellwattError, match="torque_constant of joint_1"):
        called(*POWER, table, "--robot", tmp_path, "--out", tmp_path)


def test_too_few_rows_for_a_model_are_refused(case, tmp_path):
    robot, table, _ = case
    pq.write_table(pq.read_table(table)[:12], tmp_path / "few.parquet")
    with pytest.raises(CellwattError, match="12 rows do not determine a model"):
        called(*POWER, tmp_path / "few.parquet", "--robot", robot, "--out", tmp_path)
