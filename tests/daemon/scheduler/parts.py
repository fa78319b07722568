"""Functions that are spread in these tests, as a worker imports them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_info

from cellwatt import ConfigError
from cellwatt.scheduler import spread, workers
from cellwatt.tables.names import understood


class Item(NamedTuple):
    """A number; ``folder`` is where the calls of a test leave their marks."""

    number: int
    folder: Path


def spectrum(seed: int) -> tuple[int, bytes]:
    values = np.random.default_rng(seed).normal(size=(60, 60))
    return seed, np.linalg.svd(values @ values.T)[1].tobytes()


def known(column: str) -> bool:
    return understood(column) is not None


def where(number: int) -> int:
    time.sleep(0.05)
    return os.getpid()


def scaled(number: float, table: dict[str, float]) -> tuple[float, int, int]:
    time.sleep(0.02)
    return number * table["scale"], os.getpid(), id(table)


def fails(number: int) -> int:
    time.sleep(0.3 if number == 4 else 0.0)
    if number in (4, 6):
        raise ConfigError(f"line {number}: wrong")
    return number


def breaks(number: int) -> int:
    if number == 2:
        raise ZeroDivisionError("by zero")
    return number


class OddError(Exception):
    def __init__(self, a: int, b: int) -> None:
        super().__init__(f"odd {a} {b}")


def odd(number: int) -> int:
    raise OddError(number, 1)


def nested(number: int) -> tuple[bool, list[int]]:
    return workers() is None, spread(abs, [-number, number], "inside")


def threads(number: int) -> int:
    np.ones((2, 2)) @ np.ones((2, 2))
    return max(library["num_threads"] for library in threadpool_info())


def dies(item: Item) -> int:
    with (item.folder / "calls").open("a") as file:
        file.write(f"{item.number}\n")
    if item.number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return item.number


def content(path: Path) -> tuple[str, bytes]:
    return str(path), path.read_bytes()
