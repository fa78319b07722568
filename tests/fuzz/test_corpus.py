"""The kept inputs of every fuzzing target, and its seeds, without the fuzzer: what held once must hold."""

from __future__ import annotations

import pytest
from fuzz.__main__ import BUDGET, KEPT
from fuzz.table import TABLE, load
from fuzz.target import clear


@pytest.fixture(autouse=True)
def no_folder_stays():
    yield
    clear()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TABLE)
def test_kept_inputs_and_seeds(name):
    target = load(name)
    seeds = list(target.seeds())
    kept = [file.read_bytes() for file in sorted((KEPT / name).iterdir())]
    assert kept
    assert sum(map(len, kept)) <= BUDGET + max(map(len, seeds))
    for data in (b"", *seeds, *kept):
        assert len(data) <= target.longest
        target.run(data)


def test_every_folder_belongs_to_a_target():
    assert {path.name for path in KEPT.iterdir() if path.is_dir()} == set(TABLE)
