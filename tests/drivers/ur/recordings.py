"""Recordings made here in the format of UR's own, for tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

COLUMNS = (
    "timestamp",
    *(f"{name}_{i}" for name in ("actual_q", "actual_qd", "actual_current") for i in range(6)),
    "actual_robot_voltage",
    "actual_robot_current",
    "robot_mode",
    "runtime_state",
)


def motion(stamps: np.ndarray) -> dict[str, np.ndarray]:
    """All columns but the timestamp at controller times (n,) s."""
    phase = 2 * np.pi * 0.7 * (stamps - stamps[0])
    out = {}
    for i in range(6):
        out[f"actual_q_{i}"] = 0.1 * (i + 1) * np.sin(phase + i)
        out[f"actual_qd_{i}"] = 0.1 * (i + 1) * 2 * np.pi * 0.7 * np.cos(phase + i)
        out[f"actual_current_{i}"] = 1.5 * np.sin(phase) + np.sqrt(2) * i
    out["actual_robot_voltage"] = 48 + 0.1 * np.sin(phase / 3)
    out["actual_robot_current"] = 2 + np.cos(phase)
    out["robot_mode"] = np.full(len(stamps), 7.0)
    out["runtime_state"] = np.where(np.arange(len(stamps)) < len(stamps) // 2, 2.0, 4.0)
    return out


def write(path: Path, stamps: np.ndarray) -> np.ndarray:
    """Write a recording with every digit; returns the table (n, columns) in the order of ``COLUMNS``."""
    columns = {"timestamp": stamps, **motion(stamps)}
    table = np.column_stack([columns[name] for name in COLUMNS])
    rows = [",".join(map(repr, row)) for row in table.tolist()]
    path.write_text("\n".join([",".join(COLUMNS), *rows]) + "\n")
    return table
