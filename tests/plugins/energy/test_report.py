import re
from xml.etree import ElementTree

import pytest

from cellwatt_plugins.energy.report import write_report
from cellwatt_plugins.energy.report.page import headline


@pytest.fixture(scope="module")
def page(outcome, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(outcome, path)
    return path.read_text()


def test_it_needs_nothing_else(page):
    assert not re.search(r"https?://|<script|<link|@import", page)
    assert len(page) < 1_000_000


def test_its_plots_are_whole(page):
    plots = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(plots) == 6  # power, shares, and two speeds with and without payload
    for plot in plots:
        ElementTree.fromstring(re.sub(r"=(label|note|grid|tick|img)\b", r'="\1"', plot))


def test_bars_are_as_long_as_their_power(page, outcome):
    bars = re.findall(r'<rect class="electronics" x="([\d.]+)" y="\d+" width="([\d.]+)"', page)[:6]
    watts = [run.electronics / run.seconds for run in outcome.findings.runs]
    scale = float(bars[0][1]) / watts[0]
    assert [float(width) / scale for _, width in bars] == pytest.approx(watts, rel=0.01)


def test_it_holds_the_numbers(page, outcome):
    fixed = outcome.findings.fixed
    assert f"{fixed.brakes:.2f} ± {fixed.brakes_uncertainty:.2f} W" in page
    for run in outcome.findings.runs:
        assert f"{run.total:.1f}" in page
    for note in outcome.findings.notes:
        assert note.split(":")[0] in page


def test_the_headline_names_the_largest_first(outcome):
    shares = [int(number) for number in re.findall(r"(\d+) %", headline(outcome.findings))]
    assert shares == sorted(shares, reverse=True)
    assert sum(shares) == pytest.approx(100, abs=2)
