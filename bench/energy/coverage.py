"""Does the truth lie within what the live stage says it is uncertain by? Drawn arms, each at tasks of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cellwatt.results import Energy

from .arms import Case
from .live import BEGIN, RATE, frames_of, run_stages
from .plant import START, production
from .product import disaggregated

SPEEDS = ((100.0, 250.0, 700.0, 1400.0), (100.0, 150.0, 200.0, 250.0))
CLASSES = (0.0002, 0.001, 0.003)
"""Of the power meter, a share of its reading."""
TASKS = 3
SIGMAS = 2.0


def drawn(seed: int) -> tuple[Case, float]:
    """An arm of any make, and the class of the meter at it, within which the meter is off."""
    rng = np.random.default_rng([seed, 99])
    current = bool(rng.random() < 0.6)
    accuracy = float(rng.choice(CLASSES))
    low, high = (0.6, 1.4) if current else (0.2, 0.6)
    case = Case(
        f"drawn_{seed}",
        1000 + seed,
        joints=int(rng.choice([6, 7])),
        size=float(rng.uniform(0.6, 1.5)),
        payload=float(rng.uniform(3, 8)),
        current=current,
        gains=(float(rng.uniform(0.7, 0.9)), float(rng.uniform(0.95, 1.15))),
        sensor=0.002,
        gear=float(rng.uniform(low, high)),
        brakes=float(rng.choice([0.0, 4.0, 7.0, 18.0])),
        separate=bool(rng.random() < 0.7),
        speeds=SPEEDS[int(rng.random() < 0.3)],
        profile=str(rng.choice(["quintic", "septic", "trapezoid"])),
        rate=float(rng.choice([100.0, 500.0])),
        returned=float(rng.choice([0.0, 0.3, 0.5, 0.7, 1.0])),
        noise=float(rng.choice([0.08, 0.3])),
        drift=float(rng.choice([0.0, 0.1, 0.3])),
        heating=float(rng.uniform(0.0, 0.08)),
        meter=float(rng.uniform(-accuracy, accuracy)),
    )
    return case, accuracy


def pulls(case: Case, accuracy: float, folder: Path) -> dict[str, list[float]]:
    """Errors of each group in stated standard deviations, one a task, of an arm that is measured to ``folder``."""
    key = disaggregated(case, folder)
    rng = np.random.default_rng([case.seed, 5])
    found: dict[str, list[float]] = {}
    for number in range(TASKS):
        points = None if number == 0 else _way(case, rng)
        speed, payload = float(rng.uniform(100, 1.2 * max(case.speeds))), float(rng.choice([0, 0.5, 1])) * case.payload
        seen, power, means = production(case, key["fixed"], speed, payload, 4, 2.0, RATE, points)
        _add_noise(seen, rng)
        for result in run_stages(frames_of(seen, power), folder, meter_class=accuracy):
            if isinstance(result, Energy):
                for group, pull in _pulls(result, key["fixed"], means).items():
                    found.setdefault(group, []).append(pull)
    return found


def _way(case: Case, rng: np.random.Generator) -> np.ndarray:
    """From where the campaign's path begins over some other places back to it: (k, n) rad."""
    start = np.array([*START, 0.2][: case.joints])
    reach = np.array([0.6, 0.4, 0.6, 0.5, 0.3, 0.3, 0.2][: case.joints])
    places = start + reach * rng.uniform(-1, 1, (int(rng.integers(2, 5)), case.joints))
    return np.vstack([start, places, start])


def _add_noise(seen: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """As in the campaign's recordings."""
    seen["velocity"] += rng.normal(0, 1e-3, seen["velocity"].shape)
    seen["torque"] += 0.001 * np.abs(seen["torque"]).max(axis=0) * rng.standard_normal(seen["torque"].shape)


def _pulls(energy: Energy, fixed: dict[str, float], means: dict[str, np.ndarray]) -> dict[str, float]:
    first, last = (round((t - BEGIN) * RATE * 1e-9) for t in (energy.start, energy.end))
    seconds = (last - first) / RATE
    true = {
        "electronics": (fixed["controller"] + fixed["robot_electronics"]) * seconds,
        "brakes": fixed["brakes"] * seconds,
        "mechanical_losses": means["mechanical"][first:last].sum() / RATE,
        "electrical_losses": means["electrical"][first:last].sum() / RATE,
        "regeneration": means["chopper"][first:last].sum() / RATE,
        "unexplained": 0.0,
    }
    said = energy.group_uncertainty
    return {name: float(energy.groups[name] - value) / said[name] for name, value in true.items() if said[name] > 0}


def within(found: dict[str, list[float]]) -> dict[str, float]:
    """Percent of the pulls of each group within ``SIGMAS``, and of all groups that some consumer takes."""
    every = [pull for group, those in found.items() if group != "unexplained" for pull in those]
    shares = {group: np.abs(those) < SIGMAS for group, those in {**found, "all": every}.items()}
    return {group: round(100 * float(np.mean(inside)), 1) for group, inside in shares.items()}
