"""``cellwatt new-outlet`` writes a webhook of blocks that passes the suite of outlets; a bad outlet does not."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner

from cellwatt.commands.new_package import OUTLET, outlet, package
from cellwatt.testing import NotConformingError, OutletConformance, OutletRig
from cellwatt.testing.outlet_rig import line_to, running_outlet
from cellwatt.testing.outlet_skeleton import SkeletonOutlet
from cellwatt.testing.outlet_suite import (
    CHECKS,
    believes_no_garbage,
    counts_what_is_refused,
    loses_nothing_when_killed,
    survives_a_cut,
)
from cellwatt.testing.recorded_cell import RecordedCell
from tests.docs.pages import ROOT, blocks
from tests.patience import eventually


def _made() -> ModuleType:
    """The test module of the package, of the skeleton itself."""
    text = package("skeleton", OUTLET)["tests/test_conformance.py"]
    module = ModuleType("skeleton_conformance")
    sys.modules[module.__name__] = module
    text = text.replace("from skeleton import", "from cellwatt.testing.outlet_skeleton import")
    exec(compile(text, "test_conformance.py", "exec"), vars(module))
    return module


MADE = _made()
(RIG,) = MADE.TestConformance.rigs


class TestSkeleton(OutletConformance):
    rigs = (RIG,)


async def test_a_result_before_the_first_row_hides_no_rows_of_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An outlet that is killed while its peer is away, and whose next start is told of an alarm first."""
    monkeypatch.setattr("cellwatt.outlets.forward.MARGIN", 0)
    async with RIG.peer() as peer, line_to(peer) as line:
        cell, place = RecordedCell(tmp_path), tmp_path / "weld-3.peer.json"
        first, second = RIG.make(line.address, cell), RIG.make(line.address, cell)
        async with running_outlet(first):
            for _ in range(20):
                first.offer(cell.frames(5))
            await eventually(lambda: len(peer.got) >= 19 and place.exists(), "rows and a position")
            kept = place.read_bytes()
            line.be("cut")
            for _ in range(20):
                first.offer(cell.frames(5))
            await eventually(first.trouble, "trouble")
        place.write_bytes(kept)
        line.be("well")
        async with running_outlet(second):
            second.offer(cell.alarm("early"))
            await eventually(lambda: second.account.received == 1, "the alarm")
            for _ in range(40):
                second.offer(cell.frames(5))
            await eventually(lambda: len(set(peer.got)) == 80, "all rows")
        cell.close()


def test_the_page_makes_one_that_keeps_the_contract(tmp_path: Path) -> None:
    """Its class, with the settings and the plain HTTP of the package, by the rig that it shows."""
    from cellwatt.testing.outlet_skeleton import outlet as module

    names = {**vars(module), **vars(MADE), "PlantHookSettings": module.SkeletonSettings}
    for block in blocks("write-an-outlet.md", "python"):
        exec(block.text, names)
    names["PlantHookOutlet"]._post = SkeletonOutlet._post
    (rig,) = names["TestConformance"].rigs
    for check in (survives_a_cut, counts_what_is_refused):
        (tmp_path / check.__name__).mkdir()
        OutletConformance().test_outlet(rig, check, tmp_path / check.__name__)


def test_the_page_names_every_check() -> None:
    page = (ROOT / "docs" / "write-an-outlet.md").read_text(encoding="utf-8")
    assert not [check.__name__ for check in CHECKS if f"| `{check.__name__}` |" not in page]


class Believer(SkeletonOutlet):
    """Takes whatever happens for an answer."""

    async def send(self, messages):
        try:
            return await super().send(messages)
        except Exception:
            return {}


class Deaf(SkeletonOutlet):
    """Never hears that something is refused."""

    async def send(self, messages):
        await super().send(messages)
        return {}


class Forgetful(SkeletonOutlet):
    """Loses what it does not send at once."""

    def __init__(self, *told):
        super().__init__(*told)
        self._forwarder.cursor._path = None


@pytest.mark.parametrize(
    ("kind", "check"),
    [(Believer, believes_no_garbage), (Deaf, counts_what_is_refused), (Forgetful, loses_nothing_when_killed)],
)
def test_an_outlet_that_breaks_the_contract_is_found(kind, check, tmp_path: Path) -> None:
    rig = OutletRig(kind, RIG.settings, RIG.peer, RIG.at, patience=0.5)
    with pytest.raises(NotConformingError):
        OutletConformance().test_outlet(rig, check, tmp_path)


def test_it_is_an_afternoon_and_names_are_put_everywhere(tmp_path: Path) -> None:
    result = CliRunner().invoke(outlet, ["plant_hook", "--folder", str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    files = package("plant_hook", OUTLET)
    assert {str(p.relative_to(tmp_path / "plant_hook")) for p in tmp_path.rglob("*") if p.is_file()} == set(files)
    assert not [path for path, text in files.items() if "skeleton" in text.lower() or "${" in text]
    assert 'plant_hook = "plant_hook:PlantHookOutlet"' in files["pyproject.toml"]
    assert sum(text.count("\n") for path, text in files.items() if path.endswith(".py") and "test" not in path) <= 150
