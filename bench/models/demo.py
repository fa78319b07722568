"""Makes ``examples/demo-power.onnx``: the model of the arm that ``cellwatt demo`` emulates.

    python bench/models/demo.py examples/demo-power.onnx

Records the demo's arm and its board, without the fault, for 40 s and trains on the frames.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import yaml
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.plugins.models.power.cases import model_of

from cellwatt.config import load
from cellwatt.demo import processes
from cellwatt.emulation.cell import devices_of, places, running
from cellwatt_plugins.models.metadata import Metadata
from cellwatt_plugins.models.power.api import write
from cellwatt_plugins.models.power.moves import read_moves
from cellwatt_plugins.robot import Arm

SOURCES = {"arm": {"driver": "ur", "host": "127.0.0.1"}, "board": {"driver": "power_board", "port": "/dev/ttyUSB0"}}
"""The demo's arm and its board."""
LENGTHS = (0.15, 0.0, 0.42, 0.39, 0.1, 0.1)
"""m from joint to joint."""
MASS = (3.0, 4.0, 2.0, 0.6, 0.4, 0.2)
"""kg."""
CONSTANT = (12.0, 12.0, 9.0, 6.5, 6.5, 6.5)
"""Nm/A."""
RESISTANCE = (1.1, 1.1, 1.2, 2.0, 2.0, 2.0)
"""Ω."""


async def record(folder: Path, seconds: float = 40.0) -> None:
    """Frames of the arm and of the board on its supply."""
    file = folder / "cell.yaml"
    sources: dict[str, dict[str, Any]] = {name: dict(source) for name, source in SOURCES.items()}
    cell = {"site": "demo", "cell": "demo", "sources": sources, "record": {"folder": str(folder)}}
    file.write_text(yaml.safe_dump(cell))
    devices = devices_of(load(file, {}), free=True)
    async with AsyncExitStack() as stack:
        emulators = await stack.enter_async_context(running(devices, time.time(), seed=4))
        for (_, name, key), value in places(devices, emulators).items():
            sources[str(name)][str(key)] = value
        file.write_text(yaml.safe_dump(cell))
        daemon = await stack.enter_async_context(processes.daemon(file, folder))
        await asyncio.sleep(seconds)
        daemon.send_signal(signal.SIGTERM)
        await daemon.wait()


def demo_robot(folder: Path) -> Path:
    """Write the description of the demo's arm, ``robot.yaml`` with its URDF; return its path.

    Joints 2 to 4 lift; their angles add up, as those of the emulated arm. Links are about right, friction is left out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = ['<robot name="demo"><link name="link_0"/>']
    axes = ("0 0 1", "0 -1 0", "0 -1 0", "0 -1 0", "0 0 1", "1 0 0")
    for i in range(6):
        along = f"0 0 {LENGTHS[i]}" if i < 2 else f"{LENGTHS[i]} 0 0"
        ahead = LENGTHS[i + 1] / 2 if 0 < i < 5 else 0.0
        size = MASS[i] * 0.02
        text.append(
            f'<link name="link_{i + 1}"><inertial><origin xyz="{ahead} 0 0"/><mass value="{MASS[i]}"/>'
            f'<inertia ixx="{size}" iyy="{size}" izz="{size}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="joint_{i + 1}" type="revolute"><parent link="link_{i}"/><child link="link_{i + 1}"/>'
            f'<origin xyz="{along}"/><axis xyz="{axes[i]}"/>'
            '<limit lower="-6.3" upper="6.3" effort="200" velocity="4"/></joint>'
        )
    (folder / "demo.urdf").write_text("\n".join([*text, "</robot>"]))
    joints = [
        {"name": f"joint_{i + 1}", "torque_constant": CONSTANT[i], "winding_resistance": RESISTANCE[i]}
        for i in range(6)
    ]
    (folder / "robot.yaml").write_text(yaml.safe_dump({"robot": "demo", "urdf": "demo.urdf", "joints": joints}))
    return folder / "robot.yaml"


def train_demo(recording: Path, robot: Path, out: Path) -> Metadata:
    """Train on a recording of the demo (its frames, or a table of them) and write the model file ``out``.

    Takes seconds, as held-out errors are not computed. Raises as ``cellwatt train power`` does.
    """
    arm = Arm.load(robot)
    moves = read_moves([recording], arm.description.names)
    return write(out, model_of(moves, arm), moves, arm)


def main(out: Path) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        asyncio.run(record(folder))
        with threadpool_limits(1):
            made = train_demo(folder, demo_robot(folder / "robot"), out)
    print(f"{out}: {made.training.rows} frames, window of {made.window}, {out.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
