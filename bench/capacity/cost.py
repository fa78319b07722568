"""What a year of many cells in a lake costs: the model with the constants of docs/capacity.md."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from capacity.model import DAYS, GB, MB, Cost, Lake, Prices, Reading, year

CHANNELS, FILES = 60, 144
MB_A_DAY: Mapping[float, tuple[float, float]] = {1.0: (42.3, 39.5), 10.0: (402.0, 401.0), 50.0: (2045.0, 1933.0)}
"""MB a day of 60 channels that are all noisy, by rows a second: in files of ten minutes, and joined; as measured."""
LISTS: Mapping[str, Prices] = {
    "S3 Standard": Prices(gb_month=0.023, puts_1000=0.005, gets_1000=0.0004, egress_gb=0.09),
    "R2 Standard": Prices(gb_month=0.015, puts_1000=0.0045, gets_1000=0.00036, egress_gb=0.0),
}
"""List prices in USD, first tier, as of ``PRICES_OF``; assumptions, not offers."""
PRICES_OF = "2026-11-24"


@dataclass(frozen=True, slots=True)
class Question:
    """How many cells of how many channels; ``weeks_read`` is how often a day a week of one channel of all is read.

    Of what is read the share ``outside`` leaves the provider. The lake keeps ``kept_days``.
    """

    cells: int = 1000
    channels: int = CHANNELS
    weeks_read: float = 1.0
    outside: float = 1.0
    kept_days: float = DAYS
    core_hours: float = 0.0


@dataclass(frozen=True, slots=True)
class Answer:
    """Of one rate: GB a day of all cells, cost of the first year, and of each after as many days as are kept."""

    rate: float
    compact: bool
    gb_a_day: float
    first: Cost
    later: Cost


def lake_of(rate: float, compact: bool, channels: int = CHANNELS) -> Lake:
    """What a cell writes a day, by rows a second."""
    return Lake(MB_A_DAY[rate][compact] * MB * channels / CHANNELS, FILES, compact)


def answers(question: Question, prices: Prices) -> Iterator[Answer]:
    """The costs for each rate, with files of ten minutes and with joined ones."""
    reading = Reading(
        cell_days=question.weeks_read * 7 * question.cells,
        share=2 / (question.channels + 4),
        outside=question.outside,
        core_hours=question.core_hours,
    )
    for rate in MB_A_DAY:
        for compact in (False, True):
            lake = lake_of(rate, compact, question.channels)
            given = question.cells, lake, reading, prices, question.kept_days
            later = year(*given, age_days=question.kept_days)
            yield Answer(rate, compact, question.cells * lake.bytes / GB, year(*given), later)


def table(question: Question, prices: Prices) -> str:
    """The answers as Markdown."""
    head = (
        "rows a second", "files of a day", "GB a day", "storage", "PUT", "GET", "egress", "compute",
        "first year", "each later year",
    )  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for answer in answers(question, prices):
        first = answer.first
        costs = (first.storage, first.put, first.get, first.egress, first.compute)
        words = (
            f"{answer.rate:g}", "joined" if answer.compact else f"{FILES}", f"{answer.gb_a_day:,.0f}",
            *(f"{cost:,.0f}" for cost in costs), f"**{first.total:,.0f}**", f"{answer.later.total:,.0f}",
        )  # fmt: skip
        lines.append("| " + " | ".join(words) + " |")
    return "\n".join(lines)
