"""Clients that we did not write, at the emulator."""

from __future__ import annotations

import asyncio
import urllib.request

import numpy as np
import pytest

from .rig import ANGLES, emulated


def listen(port: int, count: int):
    """States that the ABBRobotEGM library reads at a port."""
    from ABBRobotEGM import EGM

    with EGM(port=port) as client:
        found = [client.receive_from_robot(2.0) for _ in range(count)]
        client.socket.close()
    return [state for good, state in found if good]


@pytest.mark.parametrize("robotware", ["6", "7"])
async def test_the_library_abb_robot_egm_reads_it(robotware):
    pytest.importorskip("ABBRobotEGM", reason="the ABBRobotEGM library is not installed")
    async with emulated(robotware=robotware) as (_, place):
        states = await asyncio.to_thread(listen, place["egm_port"], 20)
    assert len(states) == 20
    np.testing.assert_array_equal(np.diff([s.header.seqno for s in states]), 1)
    np.testing.assert_allclose(states[0].joint_angles, np.degrees(ANGLES))
    np.testing.assert_allclose(states[0].joint_angles_planned, np.degrees(ANGLES))
    times = np.array([s.clock[0] + s.clock[1] * 1e-6 for s in states])
    np.testing.assert_allclose(np.diff(times), 0.004, atol=2e-6)
    assert states[0].motors_on and states[0].rapid_running
    assert states[0].cartesian.pos.x == 500.0 and states[0].cartesian.pos.z == 812.5
    if robotware == "7":
        np.testing.assert_allclose(states[0].measured_force, [1.5, 0, 0, 0, 0, -0.25])


def fetch(url: str, digest: bool) -> bytes:
    words = urllib.request.HTTPPasswordMgrWithDefaultRealm()
    words.add_password(None, url, "Default User", "robotics")
    handler = urllib.request.HTTPDigestAuthHandler if digest else urllib.request.HTTPBasicAuthHandler
    with urllib.request.build_opener(handler(words)).open(url, timeout=5) as answer:
        return answer.read()


@pytest.mark.parametrize(("robotware", "path"), [("6", "/rw/panel/ctrlstate"), ("7", "/rw/panel/ctrl-state")])
async def test_the_standard_library_reads_its_pages(robotware, path):
    async with emulated(robotware=robotware) as (_, place):
        page = await asyncio.to_thread(fetch, f"http://127.0.0.1:{place['port']}{path}", robotware == "6")
    assert b'<span class="ctrlstate">motoron</span>' in page
