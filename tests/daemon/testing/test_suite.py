"""The suite passes what is right, and each of its checks refuses what is wrong."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest

from cellwatt.testing import DriverConformance, NotConformingError
from cellwatt.testing.checks import CHECKS, checks_of
from cellwatt.testing.skeleton import SkeletonDriver
from tests.patience import PATIENCE

from . import broken

RIGHT = broken.rig(SkeletonDriver, patience=PATIENCE)


class TestSkeleton(DriverConformance):
    rigs = (RIGHT,)

    @pytest.fixture(autouse=True)
    def _registered(self, register):
        register(SkeletonDriver)


MISTAKES = [
    ("settings_are_checked", broken.TakesAnyValue, r"timeout: \[.*must be reported .* at line 10"),
    ("settings_are_checked", broken.SaysNothingOfAKey, "without a docstring: host"),
    ("starts_and_stops", broken.DeclaresNothingItSends, "writes: found 'READ"),
    ("starts_and_stops", broken.Returns, r"run\(\) returned"),
    ("starts_and_stops", broken.NeverSaysConnected, r"inlet.connected\(identity\) was never called"),
    ("starts_and_stops", broken.CountsNothing, r"expected = received \+ missed \+ dropped does not hold whenever"),
    pytest.param(
        "starts_and_stops",
        broken.GoesOnAfterTheEnd,
        r"readings arrived after run\(\) had been cancelled",
        marks=pytest.mark.leaves_behind,
    ),
    pytest.param(
        "starts_and_stops", broken.LeavesTheSocketOpen, "files or sockets stay open", marks=pytest.mark.leaves_behind
    ),
    ("cancels_anywhere", broken.SwallowsCancellation, "run() was cancelled and returned"),
    ("reconnects", broken.LeaksOsErrors, r"raised ConnectionRefusedError.*map it to ConnectError"),
    ("reconnects", broken.DoesNotSayWhere, "lacks the address: found 'cannot connect'"),
    ("stamps_are_right", broken.AsksAfterTheAnswer, "is after arrival"),
    ("stamps_are_right", broken.StampsFromOneProcessStart, "before the driver was started"),
    ("stamps_are_right", broken.CountsMicroseconds, "is it in ns"),
    ("stamps_are_right", broken.StandsStill, "device_time does not rise"),
    pytest.param(
        "keeps_its_rates", broken.PollsTooSlowly, "declared at 50 Hz: in .* due, .* arrived", marks=pytest.mark.slow
    ),
    ("values_are_in_their_units", broken.GivesMilliwatts, "supply.power: .* is it converted to SI units"),
    ("only_reads", broken.SwitchesTheLoad, r"not allowed by may_send: .*OUTPUT OFF"),
    pytest.param(
        *("keeps_the_loop_free", broken.Blocks, r"was blocked for more than 0.5 s, in:(?s:.*)time\.sleep"),
        marks=pytest.mark.blocks_loop,
    ),
    ("survives_loss", broken.SwallowsLoss, "loss leaving a trace"),
    ("survives_loss", broken.MapsNothing, "raised TimeoutError"),
    ("survives_half_frame", broken.MapsNothing, "raised TimeoutError"),
    ("survives_garbage", broken.MapsNothing, "raised ValueError"),
    ("survives_delay", broken.MapsNothing, "raised TimeoutError"),
    ("survives_stall", broken.MapsNothing, "raised TimeoutError"),
    ("survives_disconnect", broken.MapsNothing, "raised IncompleteReadError"),
]


@pytest.mark.parametrize(("check", "driver", "message"), MISTAKES, ids=lambda x: getattr(x, "__name__", None))
def test_a_broken_driver_is_refused(check, driver, message, register, tmp_path):
    register(driver)
    rig = broken.rig(driver)
    with pytest.raises(NotConformingError) as refused:
        asyncio.run(checks_of(rig)[check](rig, tmp_path))
    assert refused.match(message.replace("()", r"\(\)"))


def test_each_check_has_a_driver_that_fails_it():
    assert {getattr(mistake, "values", mistake)[0] for mistake in MISTAKES} == set(checks_of(RIGHT))


def test_a_driver_that_is_not_registered_is_told_how(tmp_path):
    with pytest.raises(NotConformingError, match=r"write NAME = 'cellwatt.testing.skeleton.driver:SkeletonDriver'"):
        asyncio.run(checks_of(RIGHT)["settings_are_checked"](RIGHT, tmp_path))


def test_an_emulator_that_fails_is_told(register, tmp_path):
    register(broken.HasAnEmulatorThatFails)
    rig = broken.rig(broken.HasAnEmulatorThatFails)
    with pytest.raises(NotConformingError, match=r"Skeleton meter: serve\(\) failed: KeyError: 'a mistake'"):
        asyncio.run(checks_of(rig)["keeps_its_rates"](rig, tmp_path))


def test_the_page_names_every_check():
    page = (Path(__file__).resolve().parents[3] / "docs" / "write-a-driver.md").read_text(encoding="utf-8")
    for check in CHECKS:
        assert f"| `{check.__name__}` |" in page


@pytest.mark.parametrize("module", ["cellwatt.testing", "cellwatt.commands.new_package"])
def test_the_kit_does_not_import_pytest(module):
    script = f"import sys, {module}; sys.exit('pytest' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
