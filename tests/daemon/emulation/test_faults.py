"""Fault injection strikes as told and counts what it did."""

from __future__ import annotations

from cellwatt.emulation import Fault, Injector


def test_probability_is_met_and_counted() -> None:
    injector = Injector(seed=3)
    injector.inject(Fault("loss", probability=0.1), 0.0)
    struck = sum(injector.strikes("loss", 1.0) is not None for _ in range(20_000))
    assert struck == injector.counts["loss"]
    assert 1800 < struck < 2200


def test_fault_ends_after_its_duration() -> None:
    injector = Injector()
    injector.inject(Fault("delay", duration=5.0), 100.0)
    assert injector.strikes("delay", 104.9) is not None
    assert injector.strikes("delay", 105.0) is None
    assert injector.strikes("delay", 101.0) is None
    assert injector.counts == {"delay": 1}


def test_one_shot_faults_happen_once_each_in_order() -> None:
    injector = Injector()
    injector.inject(Fault("stall", seconds=1.0), 0.0)
    injector.inject(Fault("stall", seconds=2.0), 0.0)
    assert [f.seconds for _ in range(3) if (f := injector.once("stall"))] == [1.0, 2.0]
    assert injector.counts == {"stall": 2}
