"""Tables II and III of ECDP as HTML, and what was identified of the joints."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from cellwatt_plugins.energy.findings import Findings, Fixed, RunEnergy


def fixed_table(robot: str, fixed: Fixed) -> str:
    """Table II: power drawn whatever the robot does."""
    cells = [
        (fixed.controller, fixed.controller_uncertainty),
        (fixed.robot_electronics, fixed.robot_electronics_uncertainty),
        (fixed.electronics, fixed.robot_electronics_uncertainty),
        (fixed.brakes, fixed.brakes_uncertainty),
    ]
    head = ["Robot", "P<sub>RC</sub> controller", "P<sub>RE</sub> robot", "P<sub>E</sub> both", "P<sub>MB</sub> brakes"]
    row = [escape(robot), *(f"{value:.2f} ± {unsure(spread)} W" for value, spread in cells)]
    return table(head, [row])


def run_table(runs: Sequence[RunEnergy]) -> str:
    """Table III: energies of a repetition in J and in percent of the total."""
    named = [
        ("Run", ""),
        ("T", "time, s"),
        ("E<sub>R</sub>", "total"),
        ("E<sub>E</sub>", "electronics"),
        ("E<sub>MB</sub>", "brakes"),
        ("L<sub>M</sub>", "mechanical<br>losses"),
        ("L<sub>E</sub>*", "electrical losses<br>and chopper"),
        ("L<sub>E</sub>", "electrical<br>losses"),
        ("E<sub>RB</sub>", "chopper"),
        ("at most", "chopper"),
        ("E<sub>M+</sub>", "positive<br>mechanical"),
        ("ε<sub>M+</sub>", "%"),
    ]
    return table([f"{symbol}<br><small>{name}</small>" for symbol, name in named], [_row(run) for run in runs])


def _row(run: RunEnergy) -> list[str]:
    def both(name: str) -> str:
        value, spread = getattr(run, name), run.uncertainty.get(name)
        if value is None:
            return "<span class=quiet>not told</span>"
        share = f"<small>{100 * value / run.total:.1f} %</small>"
        return f"{value:.1f}<small> ± {unsure(spread or 0.0)}</small><br>{share}"

    names = ("electronics", "brakes", "mechanical_losses", "electrical_losses_with_regeneration")
    return [
        f"{run.speed_mm_s:g} mm/s, {run.payload_kg:g} kg<br><small>{run.repetitions} repetitions</small>",
        f"{run.seconds:.2f}",
        f"{run.total:.1f}<small> ± {unsure(run.uncertainty.get('total') or 0.0)}</small>",
        *(both(name) for name in (*names, "electrical_losses", "regeneration")),
        f"{run.regeneration_upper_bound:.1f}",
        f"{run.positive_mechanical:.1f}",
        f"{run.motion_efficiency_percent:.1f}",
    ]


def payload_table(findings: Findings) -> str:
    """ε_P (eq. 21) by speed."""
    efficiency = findings.payload_efficiency_percent
    return table([f"{speed} mm/s" for speed in efficiency], [[f"{value:.1f} %" for value in efficiency.values()]])


def joint_table(findings: Findings) -> str:
    """Table of the identified drive and friction of each joint."""
    head = ["Joint", "torque as given", "R Ω", "switching W/A", "eddy currents W s²/rad²", "hysteresis W s/rad"]
    head += ["f<sub>v</sub> Nm s/rad", "f<sub>c</sub> Nm", "f<sub>o</sub> Nm", "f<sub>w</sub> Nm s²/rad²"]
    rows = [
        [
            escape(drive.joint),
            f"× {drive.torque_gain:.3f}<small> ± {drive.torque_gain_uncertainty:.3f}</small>",
            *(f"{v:.3f}" for v in (drive.winding_resistance, drive.switching, drive.iron, drive.hysteresis)),
            *(f"{v:.2f}" for v in (friction.viscous, friction.coulomb, friction.offset, friction.windage)),
        ]
        for drive, friction in zip(findings.drives, findings.friction, strict=True)
    ]
    return table(head, rows)


def unsure(spread: float) -> str:
    """An uncertainty, never shown as 0 where it is not: 0.01 at least."""
    return f"{spread:.1f}" if spread >= 1 else f"{spread:.2f}" if spread >= 0.01 else "0.01" if spread > 0 else "0"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """An HTML table of cells that are HTML already."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<div class=wide><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
