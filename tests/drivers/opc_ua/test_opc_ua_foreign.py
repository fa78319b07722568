"""The driver at a server of node-opcua, which shares no code with asyncua; NODE_PATH leads to its packages."""

from __future__ import annotations

import asyncio
import math
import shutil
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from cellwatt_drivers.opc_ua import OpcUaDriver, OpcUaSettings
from tests.daemon.outlets.zenoh.processes import free_port

from ..inlet import CollectingInlet
from ..running import repeated
from .rig import certificate

TAGS = {
    "supply.power": {"node": "ns=plc;s=Power", "unit": "kW"},
    "joint_1.position": {"path": "plc:Cell/plc:Position", "index": 0, "unit": "deg"},
    "cell.number": {"node": "ns=plc;s=Number", "unit": 1, "kind": "counter"},
    "cell.still": {"node": "nsu=urn:other:plc;s=Still", "unit": 1, "kind": "discrete"},
}


def _lacks() -> str:
    """Why there is no such server here; empty where there is."""
    if shutil.which("node") is None:
        return "node is not installed"
    found = subprocess.run(["node", "-e", "require.resolve('node-opcua-server')"], capture_output=True, check=False)
    return "the package node-opcua-server is not found by node" if found.returncode else ""


LACKS = _lacks()


@asynccontextmanager
async def served(folder: Path) -> AsyncIterator[int]:
    port = free_port()
    script = Path(__file__).with_name("other_server.js")
    process = await asyncio.create_subprocess_exec(
        "node", str(script), str(port), str(folder / "pki"), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    try:
        assert process.stdout
        while b"ready" not in (line := await process.stdout.readline()):
            assert line, "it ended"
        yield port
    finally:
        process.kill()
        await process.communicate()


@pytest.mark.skipif(bool(LACKS), reason=LACKS)
async def test_a_server_of_another_library_is_read(tmp_path):
    files = await asyncio.to_thread(certificate, tmp_path, "client")
    common = {"host": "127.0.0.1", "path": "/UA/Other", "tags": TAGS, "namespaces": {"plc": "urn:other:plc"}}
    common |= {"rate": "20 Hz", "publish": "100 ms"}
    async with served(tmp_path) as port:
        for security in ({}, *({"security": s, "certificate": files[0], "key": files[1]} for s in ("sign", "encrypt"))):
            settings = OpcUaSettings.model_validate(common | {"port": port} | security)
            async with repeated(OpcUaDriver("plc", settings, CollectingInlet())) as run:
                await run.inlet.until(lambda o, run=run: o.account.received > 30 or bool(run.failures))
            inlet = run.inlet
            assert not run.failures and not inlet.resets
            good = inlet.values[np.isfinite(inlet.values).all(axis=1)]
            assert good[:, [0, 1, 3]] == pytest.approx(np.tile([1500.0, math.radians(90), 1.0], (len(good), 1)))
            assert (np.diff(good[:, 2]) >= 0).all()
            assert inlet.account.counters["status BadSensorFailure"] > 0
