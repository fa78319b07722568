"""The conformance suite as a class for pytest, which is not imported here."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from cellwatt.testing.checks import Check, checks_of
from cellwatt.testing.rig import Rig

if TYPE_CHECKING:
    import pytest


class DriverConformance:
    """Derive from it and set ``rigs``: each check of each driver is a test::

    class TestConformance(DriverConformance):
        rigs = (Rig(MyDriver, {"rate": "20 Hz"}, may_send=re.compile(rb"(READ\\n)*").fullmatch),)
    """

    rigs: ClassVar[Sequence[Rig]] = ()

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """One test for each rig and check."""
        cases = [(rig, check) for rig in self.rigs for check in checks_of(rig).values()]
        names = [f"{rig.driver.__name__}-{name}" for rig in self.rigs for name in checks_of(rig)]
        metafunc.parametrize(("rig", "check"), cases, ids=names)

    def test_driver(self, rig: Rig, check: Check, tmp_path: Path) -> None:
        """The driver passes this check of the contract."""
        asyncio.run(check(rig, tmp_path))
