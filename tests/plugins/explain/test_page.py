"""The pages of alarms, mismatch and reports, filled with what the stage and the explanation really give."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.daemon.outlets.page.cell import API, client, served
from tests.plugins.explain import plant
from tests.plugins.explain.calling import explained
from tests.plugins.explain.plant import REAL, Missing, loaded

PAYLOAD = 2.0  # kg that the simulation does not know of


@pytest.fixture(scope="module")
def reports(arm, tmp_path_factory):
    """A folder in which an explanation was written as ``cellwatt explain`` does."""
    missing = Missing(arm=loaded(REAL, PAYLOAD, 0.12))
    runs = [plant.record("run_01", 1, missing), plant.record("run_02", 2, missing)]
    found = explained(arm, runs)
    folder = tmp_path_factory.mktemp("reports") / "one"
    folder.mkdir()
    (folder / "findings.json").write_text(json.dumps(found.as_json()))
    found.report(folder / "report.html")
    return folder.parent


async def test_the_pages_of_mismatch_and_reports_tell_what_was_missing(reports):
    async with served(reports=reports) as page, client() as browser:
        told, listed = [await (await browser.get(f"{page.url}{API}/{what}")).json() for what in ("mismatch", "reports")]
    (effect,) = told["effects"]
    assert (effect["effect"], effect["joint"]) == ("payload", None)
    assert effect["confidence"] > 0.9
    assert str(PAYLOAD) in effect["statement"] or "2.0" in effect["statement"]
    assert np.isfinite([told["before"], told["after"]]).all()
    assert told["after"] < 0.2 * told["before"]
    assert told["unit"]
    (report,) = listed["reports"]
    assert report["finding"] == told["finding"]
    assert listed["broken"] == []
    assert told["href"] == report["href"]
