"""Which inputs are kept."""

from __future__ import annotations

from fuzz.kept import branches_of, smallest

from cellwatt.outlets.zenoh.keys import escape


def run(data: bytes) -> None:
    if data:
        escape(data.decode())


def test_small_inputs_that_run_something_new_are_kept():
    assert smallest(run, [b"", b"long name", b"a", b"b", b"a/b", b"a/b/c"], 100) == [b"a", b"a/b"]


def test_no_more_than_the_budget():
    assert smallest(run, [b"a", b"a/b"], 1) == [b"a"]


def test_branches_are_those_of_the_packages():
    assert branches_of(run, b"") == set()
    assert {line for _, _, line in branches_of(run, b"a")}
