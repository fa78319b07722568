"""Supply power of a UR3e: explained on four short moves, judged on the fifth, in turn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from models import ur3e

from cellwatt_plugins.robot import Arm
from real.product import ExplainError, explain, simulate
from real.recording import Float

FOLDER = ur3e.FOLDER


def supply(data: Path, work: Path) -> dict[str, Any]:
    """Error W of each move's power as the others predict it: by the model, by five pooled terms, by a constant.

    A move that `explain` refuses to be explained without is told with the reason.
    """
    robot = ur3e.write_robot(work)
    moves = ur3e.write_moves(data, work)
    terms = [_terms(Arm.load(robot), pq.read_table(move)) for move in moves]
    power = [pq.read_table(move)["power"].to_numpy() for move in moves]
    left: dict[str, list[Float]] = {"constant": [], "five terms": [], "model": []}
    refused, named, seconds = {}, {}, 0.0
    for i, move in enumerate(moves):
        others = [j for j in range(len(moves)) if j != i]
        seen = np.concatenate([power[j] for j in others])
        solved = np.linalg.lstsq(np.concatenate([terms[j] for j in others]), seen, rcond=None)[0]
        left["constant"].append(power[i] - seen.mean())
        left["five terms"].append(power[i] - terms[i] @ solved)
        out = work / f"without_{move.stem}"
        try:
            said = explain([moves[j] for j in others], robot, out, "--no-report", "-q")
            left["model"].append(power[i] - _told(move, out))
        except ExplainError as error:
            refused[move.stem] = str(error)
            continue
        seconds += said.seconds
        named[move.stem] = [f["statement"] for f in said.findings]
    error = {name: _rms(np.concatenate(parts)) for name, parts in left.items() if parts}
    by_move = {name: [_rms(part) for part in parts] for name, parts in left.items()}
    return {"power_error": error, "by_move": by_move, "refused": refused, "named": named, "seconds": round(seconds, 1)}


def _terms(arm: Arm, table: pa.Table) -> Float:
    """Columns (N, 5): a constant and, summed over joints, current², speed, speed² and mechanical power."""
    n = arm.joints
    speed, current = (
        np.column_stack([table[f"{stem}_{j + 1}"].to_numpy() for j in range(n)]) for stem in ("qd", "current")
    )
    mechanical = current * arm.column("torque_constant") * speed
    sums = [(current**2).sum(axis=1), np.abs(speed).sum(axis=1), (speed**2).sum(axis=1), mechanical.sum(axis=1)]
    return np.column_stack([np.ones(len(speed)), *sums])


def _told(move: Path, out: Path) -> Float:
    """Power (N,) W that the explained model says of a move of which it gets the motion alone."""
    table = pq.read_table(move)
    motion = out / "motion.parquet"
    pq.write_table(table.select([c for c in table.column_names if not c.startswith(("current", "power"))]), motion)
    told = pq.read_table(simulate(out / "model.yaml", motion, out / "prediction.parquet"))
    return np.interp(table["t"].to_numpy(), told["t"].to_numpy(), told["power"].to_numpy())


def _rms(values: Float) -> float:
    return round(float(np.sqrt(np.mean(np.square(values)))), 3)
