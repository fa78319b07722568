"""Counts that do not fall, and series that stay few."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from cellwatt.outlets.metrics.catalogue import CATALOGUE
from cellwatt.outlets.metrics.outlet import Meter
from tests.daemon.outlets.metrics.cell import alarm, energy, frames, health, source
from tests.daemon.outlets.zenoh.fake_cell import EPOCH

NAN = float("nan")


def meter_of(most: int = 200, channels: tuple[str, ...] = ("*",)) -> Meter:
    return Meter(channels, most, EPOCH)


def told(meter: Meter, metric: str) -> dict[tuple[str, ...], float]:
    return dict(meter.samples()[f"cellwatt_{metric}"])


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 1000), st.integers(0, 50)), max_size=50))
def test_no_count_falls_while_what_counts_it_lives(steps: list[tuple[int, int, int]]) -> None:
    """Lives, what was received within them, and samples missed that may be taken back."""
    meter, before, life, received = meter_of(), {}, 0, 0
    for turn, more, missed in steps:
        if turn == 0:
            life, received = life + 1, 0
            before.clear()
        received += more
        meter.health(health(collect=life, sources={"arm": source(received, {"timeout": missed}, expected=received)}))
        for name, series in meter.samples().items():
            if CATALOGUE[name].type == "counter":
                for labels, value in series:
                    assert value >= before.get((name, labels), 0.0)
                    before[name, labels] = value


def test_what_is_begun_anew_counts_from_the_beginning() -> None:
    meter = meter_of()
    for collect, received, missed, told_missed in (
        (1, 1000, 5, 5.0),
        (1, 1010, 4, 5.0),  # a late sample is not taken back
        (2, 2000, 1, 1.0),  # another process, more received
        (2, 10, 0, 0.0),  # the same process, made anew by a reload
    ):
        meter.health(health(collect=collect, sources={"arm": source(received, {"gap": missed})}))
        assert told(meter, "samples_missed") == {("arm", "gap"): told_missed}
        assert told(meter, "samples_lost") == {("arm",): told_missed}
        assert told(meter, "samples_received") == {("arm",): float(received)}


def test_power_is_that_of_the_newest_frame_in_watts_alone() -> None:
    meter = meter_of(channels=("mains.*", "arm.bus.*", "arm.joint_1.*"))
    meter.frames(frames((0.1, 5.0, 300.0), (0.2, 6.0, NAN)))
    assert told(meter, "power_watts") == {("arm.bus.power",): 6.0}
    meter.frames(frames((0.1, 5.0, 300.0)))
    assert told(meter, "power_watts") == {("arm.bus.power",): 5.0, ("mains.supply.power",): 300.0}


def test_energy_that_comes_back_is_counted_apart() -> None:
    meter = meter_of()
    meter.energy(energy("task_1", 80.0, motion=100.0, braking=-20.0))
    meter.energy(energy("task_1", 60.0, motion=50.0, braking=10.0))
    given, returned = told(meter, "energy_joules"), told(meter, "energy_returned_joules")
    assert given == {("task_1", "motion"): 150.0, ("task_1", "braking"): 10.0}
    assert returned == {("task_1", "motion"): 0.0, ("task_1", "braking"): 20.0}
    assert sum(given.values()) - sum(returned.values()) == 140.0 == told(meter, "energy_measured_joules")["task_1",]
    assert told(meter, "task_repetitions") == {("task_1",): 2.0}


def test_an_alarm_that_is_over_is_told_as_none() -> None:
    meter = meter_of()
    up = [alarm("error", "joint_fault", acknowledged=True), alarm("error", "joint_fault"), alarm("info", "meter")]
    meter.health(health(alarms=up, shelved=[{}]))
    assert told(meter, "alarms_active") == {("error", "joint_fault"): 2.0, ("info", "meter"): 1.0}
    assert (told(meter, "alarms_acknowledged"), told(meter, "alarms_shelved")) == ({(): 1.0}, {(): 1.0})
    meter.health(health())
    assert told(meter, "alarms_active") == {("error", "joint_fault"): 0.0, ("info", "meter"): 0.0}


def test_series_stay_few_and_the_same_ones() -> None:
    meter = meter_of(most=3)
    meter.health(health(sources={f"s{n}": source(n) for n in range(5)}))
    first = told(meter, "source_up")
    assert len(first) == 3
    assert told(meter, "series_left_out")["cellwatt_source_up",] == 2.0
    meter.health(health(sources={f"s{n}": source(n) for n in range(4, -1, -1)}))
    assert told(meter, "source_up").keys() == first.keys()
    meter.health(health(sources={f"s{n}": source(n) for n in (1, 3, 4)}))  # one that is gone makes room
    assert told(meter, "source_up").keys() == {("s1",), ("s3",), ("s4",)}
    meter.frames(frames((0.0, 1.0, 2.0)))
    assert all(len(series) <= 3 for name, series in meter.samples().items() if name != "cellwatt_series_left_out")


def test_a_successor_goes_on_with_all_totals() -> None:
    before, after = meter_of(), meter_of()
    before.health(health(sources={"arm": source(1000, {"gap": 5})}))
    before.energy(energy("task_1", 80.0, motion=80.0))
    after.succeed(before)
    assert told(after, "samples_missed") == {("arm", "gap"): 5.0}
    after.health(health(sources={"arm": source(1010, {"gap": 4})}))
    after.energy(energy("task_1", 20.0, motion=20.0))
    assert told(after, "samples_missed") == {("arm", "gap"): 5.0}
    assert told(after, "energy_joules") == {("task_1", "motion"): 100.0}
