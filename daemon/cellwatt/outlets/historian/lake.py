"""Lets a process bring the record into the lake, again and again."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from pydantic import SecretStr

from cellwatt.account import Account
from cellwatt.child import ends_with_parent
from cellwatt.errors import OutletError
from cellwatt.outlets.apart.process import ending
from cellwatt.outlets.historian.settings import LakeSettings

MODULE: Final = "cellwatt.outlets.historian.worker"
PAUSE: Final = 30.0
"""s until the next try after one that failed, at most."""


class Lake:
    """Runs the process every some time; counts what it tells in ``account``."""

    def __init__(self, settings: LakeSettings, told: dict[str, Any], account: Account) -> None:
        self._settings, self._account = settings, account
        self._told = {**told, "settings": _plain(settings)}
        self.problem: str | None = None
        """Reason why the last run failed; ``None`` if it did not."""

    async def run(self) -> None:
        """Export until cancelled. Raises ``OutletError`` where that can never be."""
        if find_spec("pyarrow") is None:
            raise OutletError("lake: pyarrow is missing: pip install pyarrow")
        while True:
            self.problem = await self.once()
            if self.problem is not None:
                self._account.count("lake: runs failed")
            await asyncio.sleep(self._settings.every if self.problem is None else min(PAUSE, self._settings.every))

    async def once(self) -> str | None:
        """Export what is new; return the reason where that failed."""
        problem: str | None = None
        process = await self._begin()
        async with ending(process):
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(json.dumps(self._told).encode())
            process.stdin.close()
            async for line in process.stdout:
                problem = self._heard(line) or problem
            code = await process.wait()
        return problem if code == 0 or problem is not None else f"lake: the process that writes it ended with {code}"

    def _heard(self, line: bytes) -> str | None:
        """Count a line of the process; return the reason where it tells one."""
        try:
            said = json.loads(line)
        except ValueError:
            return None
        if "error" in said:
            return str(said["error"])
        self._account.expect(said["rows"] + said["lost"])
        self._account.receive(said["rows"])
        self._account.miss(said["lost"], "lake: no longer in the record")
        if said["rows"] or not said["lost"]:
            what = f"files of {said['table']}" if said["rows"] else "sessions without any of its channels"
            self._account.count(f"lake: {what}")
        return None

    async def _begin(self) -> asyncio.subprocess.Process:
        pipe = asyncio.subprocess.PIPE
        try:
            return await asyncio.create_subprocess_exec(
                sys.executable, "-m", MODULE, stdin=pipe, stdout=pipe, preexec_fn=ends_with_parent(signal.SIGKILL)
            )
        except OSError as error:
            raise OutletError(f"lake: the process that writes it cannot be started: {error.strerror}") from error


def _plain(settings: LakeSettings) -> dict[str, Any]:
    """Settings with their secrets, for the process that writes and nobody else."""
    found = settings.model_dump(mode="python")
    secrets = {k: v.get_secret_value() for k, v in found.items() if isinstance(v, SecretStr)}
    paths = {k: str(v) for k, v in found.items() if isinstance(v, Path)}
    return {**found, **secrets, **paths}
