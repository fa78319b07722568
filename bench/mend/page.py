"""The figures as tables for the documentation."""

from __future__ import annotations

from typing import Any

from concealed.page import table

Row = dict[str, Any]
METHODS = {"before": "the user's file", "mended": "mended", "sysid": "`mujoco.sysid`"}


def place(effect: Row) -> str:
    """An effect with its joint."""
    joint = effect["joint"]
    return effect["effect"].replace("_", " ") + ("" if joint is None else f" at {joint}")


def markdown(figures: Row) -> str:
    """What each arm had and what was found; errors on sealed motion, friction stated and soft; the joints' numbers."""
    first = next(iter(figures.values()))
    methods = [m for m in METHODS if m in first["errors"]]
    missing = table(
        ["arm", "kind", "missing in the file", "named", "cannot be written in it (Nm rms)"],
        [
            [
                name,
                x["robot"],
                ", ".join(map(place, x["required"])) or "nothing",
                ", ".join(place(f) for f in x["found"] if f["kind"] == "missing") or "nothing",
                ", ".join(f"{place(e)}: {e['rms']:.2g}" for e in x["left"] if e["unit"] == "N*m") or "–",
            ]
            for name, x in figures.items()
        ],
    )
    errors = table(
        ["arm", *(METHODS[m] for m in methods), "`model.yaml`", "best possible"],
        [[name, *(f"{x['in_noise'][m]:.2f}" for m in [*methods, "model", "floor"])] for name, x in figures.items()],
    )
    soft = table(
        ["arm", *(METHODS[m] for m in methods)],
        [[name, *(f"{x['in_noise_soft'][m]:.2f}" for m in methods)] for name, x in figures.items()],
    )
    numbers = table(
        ["arm", *(METHODS[m] for m in methods)],
        [
            [
                name,
                *(
                    f"{n['median']:.1f} % ({n['worst']:.0f} %, {n['where']})"
                    for n in (x["numbers"][m] for m in methods)
                ),
            ]
            for name, x in figures.items()
        ],
    )
    return "\n\n".join([missing, errors, soft, numbers])
