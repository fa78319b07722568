"""Tables of ``docs/models.md``: each part of the benchmark between marks of its own, so that one can be made anew."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from models.epochs import EpochTables, Row
from models.power import ECBOT, PUBLISHED, Errors, Size, Speed
from models.static import StaticTables
from models.ur10e import PUBLISHED_WORST, Currents


class Spread(Protocol):
    median: float
    lowest: float
    highest: float


def replace(page: Path, part: str, text: str) -> None:
    """Put the text of a part in its place. Raises ``ValueError`` where the page has no such place."""
    begin, end = f"<!-- bench/models.py: {part} -->", "<!-- end -->"
    before, found, rest = page.read_text().partition(begin)
    if not found:
        raise ValueError(f"{page} has no line {begin}")
    page.write_text(f"{before}{begin}\n\n{text}\n\n{end}{rest.partition(end)[2]}")


def static(tables: StaticTables) -> str:
    """Methods beside the paper's figures, then the number of poses."""
    rows = [
        (
            m.method,
            "–" if m.published is None else "{:.2f} / {:.3f} / {:.1f}".format(*m.published),
            _spread(m.rmse_nm, 2),
            _spread(m.r2, _digits(m.r2)),
            _spread(m.mape_percent, 1),
            _spread(m.never_collected_r2, _digits(m.never_collected_r2)),
        )
        for m in tables.methods
    ]
    head = ("method", "paper: RMSE, Nm / R² / MAPE, %", "RMSE, Nm", "R²", "MAPE, %", "R², poses never collected")
    few = [(str(row.poses), _spread(row.rmse_nm, 2), _spread(row.r2, 5)) for row in tables.poses]
    told = (
        f"{tables.arms} arms; the paper's order is kept on {tables.in_order} of them. Training took "
        f"{_spread(tables.training_s, 1)} s of one core, one pose through the file {_spread(tables.frame_us, 0)} µs. "
        f"{_spread(tables.coverage_percent, 1)} % of true sums lay within the 90 % interval."
    )
    count = f"The best model by the number of poses, on poses never collected; {tables.arms_of_few} arms:"
    return f"{_table(head, rows)}\n\n{told}\n\n{count}\n\n{_table(('poses', 'RMSE, Nm', 'R²'), few)}"


def epochs(tables: EpochTables) -> str:
    """The course of the paper's networks."""
    gravity, *rows = tables.rows
    methods = list(dict.fromkeys(row.method for row in rows))
    found = {(row.method, row.epochs): row for row in rows}

    def cell(row: Row) -> str:
        return f"{row.r2.median:.3f} ({row.r2.lowest:.3f} … {row.r2.highest:.3f}); {row.mape_percent.median:.1f}"

    course = [
        (str(n), *(cell(found[m, n]) for m in methods), "{}, {}".format(*tables.in_order[n])) for n in tables.in_order
    ]
    head = ("epochs", *methods, "arms in the paper's order")
    told = f"Gravity: {cell(gravity)} on the same poses. {tables.arms} arms, {gravity.left_out} poses left out."
    return "\n\n".join([_table(head, course), told])


def power(errors: Sequence[Errors]) -> str:
    """Median (least … greatest) over the arms of a kind."""
    kinds = list(dict.fromkeys((e.arm.partition(",")[0], e.method) for e in errors))
    rows = []
    for kind, method in kinds:
        found = [e for e in errors if (e.arm.partition(",")[0], e.method) == (kind, method)]
        rows.append(
            (
                kind,
                method,
                f"{PUBLISHED[method]:.2f}" if method in PUBLISHED else "–",
                _over([e.energy_mean for e in found], 2),
                f"{max(e.energy_worst for e in found):.2f}",
                _over([e.power / e.noise for e in found], 2),
                _over([max(e.current) for e in found], 1),
            )
        )
    head = ("arm", "method", "paper, %", "energy error a move, %", "worst, %", "power RMSE / noise", "current, %")
    return _table(head, rows)


def curve(sizes: Sequence[Size]) -> str:
    """Errors by the number of moves."""
    rows = [
        (
            str(s.moves),
            f"{s.minutes:.1f}",
            f"{s.energy_mean:.3f}",
            f"{s.power_over_noise:.2f}",
            f"{s.current_worst:.1f}",
        )
        for s in sizes
    ]
    return _table(("moves", "minutes", "energy error a move, %", "power RMSE / noise", "current, worst joint, %"), rows)


def ur3e(errors: Sequence[Errors]) -> str:
    """Each move by a model of the other four."""
    rows = [(e.method, f"{e.power:.2f}", f"{e.energy_mean:.2f}", f"{e.energy_worst:.1f}") for e in errors]
    told = (
        f"White noise of the measured power: {errors[0].noise:.2f} W. "
        f"The library EcBot reports {ECBOT[0]} to {ECBOT[1]} W of test RMSE for UR, Franka and Kinova arms."
    )
    return f"{_table(('method', 'power RMSE, W', 'energy error a move, %', 'worst, %'), rows)}\n\n{told}"


def ur10e(currents: Sequence[Currents]) -> str:
    """RMSE of each joint, % of its spread (A)."""
    head = ("recording", "model of", *(str(i + 1) for i in range(6)))
    rows = [
        (c.recording, c.trained_on, *(f"{s:.1f} ({a:.2f})" for s, a in zip(c.share, c.ampere, strict=True)))
        for c in currents
    ]
    return f"{_table(head, rows)}\n\nThe paper's largest error of a motor current, on its UR5: {PUBLISHED_WORST} %."


def speed(found: Speed) -> str:
    """Time of the file alone."""
    return (
        f"Window of {found.window}: {found.median:.0f} µs a frame in the median, 99 % below {found.highest:.0f} µs; "
        f"{found.processor:.0f} µs of processor time in the mean."
    )


def _spread(spread: Spread, digits: int) -> str:
    return _over([spread.lowest, spread.median, spread.highest], digits)


def _digits(r2: Spread) -> int:
    """Decimals of R²: one more than up to its first that is not 9 in the median, five at most."""
    return min(5, 1 + int(np.ceil(-np.log10(max(1 - r2.median, 1e-9)))))


def _over(values: Sequence[float], digits: int) -> str:
    return f"{np.median(values):.{digits}f} ({min(values):.{digits}f} … {max(values):.{digits}f})"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))
