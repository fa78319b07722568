"""The page of energies, filled with what the stage gives of an arm whose true consumers the plant knows."""

from __future__ import annotations

import json
import shutil

import pytest
from energy.live import BEGIN, RATE, frames_of, run_stages
from energy.plant import production

from cellwatt.results import Energy
from tests.daemon.outlets.page.told import page_told


@pytest.fixture(scope="module")
def produced(measured, outcome, tmp_path_factory):
    """Results of the stages, the true power in W and the true mechanical losses in W of each frame."""
    case, campaign, key = measured
    folder = tmp_path_factory.mktemp("cell")
    shutil.copytree(campaign, folder, dirs_exist_ok=True)
    (folder / "out").mkdir(exist_ok=True)
    (folder / "out" / "energy.json").write_text(json.dumps(outcome.findings.as_json()))
    seen, power, true = production(case, key["fixed"], 500.0, 5.0, 4, 2.0, RATE)
    return run_stages(frames_of(seen, power), folder), power, true["mechanical"]


async def test_the_page_has_each_repetition_of_a_task_with_its_true_energy(produced, tmp_path):
    results, power, mechanical = produced
    given = [result for result in results if isinstance(result, Energy)]
    async with page_told(tmp_path, results) as ask:
        told = (await ask("state"))["energies"]
    assert {task: len(shown) for task, shown in told.items()} == {
        task: sum(energy.task == task for energy in given) for task in {energy.task for energy in given}
    }
    shown = [energy for of_task in told.values() for energy in of_task]
    assert len(shown) >= 3
    for energy in shown:
        part = slice(*(round((energy[at] * 1e6 - BEGIN) * RATE * 1e-9) for at in ("start", "end")))
        total = power[part].sum() / RATE
        assert energy["total"] == pytest.approx(total, rel=1e-6)
        assert energy["groups"]["mechanical_losses"] == pytest.approx(mechanical[part].sum() / RATE, abs=0.01 * total)
        assert sum(energy["groups"].values()) == pytest.approx(total, rel=1e-6)
