"""The conformance suite as a pytest class."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import pytest

from cellwatt.testing.checks import Check, checks_of
from cellwatt.testing.rig import Rig


class DriverConformance:
    """Derive from it and set ``rigs``: each check of each driver is a test::

    class TestConformance(DriverConformance):
        rigs = (Rig(MyDriver, {"rate": "20 Hz"}, may_send=re.compile(rb"(READ\\n)*").fullmatch),)
    """

    rigs: ClassVar[Sequence[Rig]] = ()

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """One test for each rig and check."""
        cases = [
            pytest.param(rig, check, id=f"{rig.driver.__name__}-{name}")
            for rig in self.rigs
            for name, check in checks_of(rig).items()
        ]
        metafunc.parametrize(("rig", "check"), cases)

    def test_driver(self, rig: Rig, check: Check, tmp_path: Path) -> None:
        """The driver passes this check of the contract."""
        asyncio.run(check(rig, tmp_path))
