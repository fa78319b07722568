"""A cell's settings."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

from cellwatt.config import load, public_config
from cellwatt.errors import ConfigError
from fuzz.target import Target, folder


@cache
def _drivers() -> None:
    """Settings classes of what the seeds name are imported once, before the first input's time is taken."""
    for seed in seeds():
        run(seed)


def run(data: bytes) -> None:
    """As the file of a cell."""
    path = folder() / "cell.yaml"
    path.write_bytes(data)
    try:
        config = load(path, {"X": "y", "PASSWORD": "secret-word"})
    except ConfigError as error:
        assert error.problems
        for problem in error.problems:
            assert "\n" not in str(problem), problem
            assert "secret-word" not in str(problem), problem
        return
    assert "secret-word" not in str(public_config(config))


def seeds() -> Iterable[bytes]:
    """A cell with everything, anchors and merges, and mistakes."""
    yield (
        b"site: plant-1\ncell: weld_3\nrobot: ur10e\nsources:\n"
        b"  arm: {driver: ur, host: 192.0.2.10, rate: 500 Hz}\n"
        b"  supply: {driver: scpi_analyzer, host: '${HOST:-192.0.2.11}', functions: [URMS, P]}\n"
        b"frames: {rate: 50 Hz}\nstages:\n  segment: {}\n"
        b"record: {folder: rec, keep: 20 GB}\nzenoh: {listen: [tcp/127.0.0.1:7447]}\n"
    )
    yield (
        b"site: &a p\ncell: *a\nsources:\n  one: &b {driver: yaskawa, host: h, rate: 50 Hz}\n"
        b"  two:\n    <<: *b\n    host: i\n  3: {drivr: kinova}\n"
        b"  abb: {driver: abb, host: ${X}, password: ${PASSWORD}}\n"
        b"zenoh: off\n"
    )


_drivers()
TARGET = Target(run, seeds, 2048)
