import pytest

from cellwatt.report import Provenance
from cellwatt.units import Units
from cellwatt_plugins.energy.report import report
from tests.daemon.report.reading import numbers, read


@pytest.fixture(scope="module")
def page(outcome, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    report(outcome.findings, outcome.identified, Provenance.here(), Units()).write(path)
    return read(path)


def test_bars_are_as_long_as_their_power(page, outcome):
    electronics = page.figures[0]["data"][0]
    assert electronics["name"] == "electronics"
    watts = [run.electronics / run.seconds for run in outcome.findings.runs]
    assert electronics["x"] == pytest.approx(watts, rel=0.001)
    whole = [sum(trace["x"][i] for trace in page.figures[0]["data"]) for i in range(len(watts))]
    assert whole == pytest.approx([run.total / run.seconds for run in outcome.findings.runs], rel=0.01)


def test_tables_have_the_numbers_of_the_findings(page, outcome):
    found = outcome.findings.as_json()
    fixed = [numbers(cell)[0] for cell in page.tables["Fixed power"][1][1:]]
    told = found["fixed"]
    electronics = (told["controller"], told["robot_electronics"])
    assert fixed == pytest.approx([*electronics, sum(electronics), told["brakes"]], abs=0.006)
    for row, run in zip(page.tables["Energies of one repetition"][1:], found["runs"], strict=True):
        names = ("seconds", "total", "electronics", "brakes", "mechanical_losses")
        assert [numbers(cell)[0] for cell in row[1:6]] == pytest.approx([run[n] for n in names], abs=0.06)
