import pytest
from click.testing import CliRunner

from cellwatt.errors import ConfigError, RecordingError
from cellwatt_plugins.fleet.command import fleet


def test_the_joint_that_wears_is_found_and_no_other(written):
    worn = [f for f in written[1]["findings"] if f["quantity"] == "friction"]
    assert [(f["cell"], f["joint"], f["what"]) for f in worn] == [("weld-2", 3, "wears")]
    assert worn[0]["percent"] == pytest.approx(50, abs=12)
    assert 0 < worn[0]["low"] < worn[0]["percent"] < worn[0]["high"]
    assert "weld-2: joint_3 wears" in worn[0]["statement"]
    assert worn[0]["first"] < worn[0]["last"]


def test_a_new_payload_changes_energy_alone(written):
    assert {f["cell"] for f in written[1]["findings"] if f["quantity"] == "energy"} <= {"weld-4", "weld-2"}


def test_what_cannot_be_used_is_named_with_its_reason(written):
    skipped = {s["place"].rpartition("/")[2]: s["why"] for s in written[1]["skipped"]}
    assert set(skipped) == {"2026-02-03_cut.parquet", "2026-02-04_power_only.csv", "no_date.csv", "stray.csv"}
    assert skipped["stray.csv"] == "it is not in a cell's folder"
    assert "no column q_1" in skipped["2026-02-04_power_only.csv"]
    assert "no date" in skipped["no_date.csv"]
    assert all(why in written[2] for why in skipped.values())
    assert {s["cell"] for s in written[1]["skipped"]} == {"weld-5", "no cell"}


def test_the_page_has_table_courses_and_what_was_skipped(written):
    page = (written[0] / "report.html").read_text()
    assert "1 joint wears" in page
    assert page.count("<figure") == 1
    assert "2026-02-03_cut.parquet" in page
    assert page.index('aria-label="Findings"') < page.index("<figure")


def test_a_lake_without_recordings_or_description_says_what_to_do(tmp_path):
    def failed(*words):
        done = CliRunner().invoke(fleet, [str(tmp_path), "--out", str(tmp_path / "out"), *words])
        return done.exception

    assert isinstance(failed(), RecordingError)
    (tmp_path / "weld-1").mkdir()
    (tmp_path / "weld-1" / "2026-01-05.csv").write_text("t,power\n0,1\n1,2\n")
    assert isinstance(error := failed(), ConfigError)
    assert "--robot 'weld-1=FILE'" in str(error)
    assert "no recording of the lake can be used" in str(failed("--robot", "weld-*=mh12"))
