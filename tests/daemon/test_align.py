from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt.align import Aligner, Counts
from cellwatt.batch import Batch, Tick
from cellwatt.channel import Channel, Quality, Stream
from cellwatt.errors import ConfigError

MS = 1_000_000
SECOND = 1000 * MS
EPOCH = 1_760_000_000 * SECOND
STEP = 20 * MS
GOOD, INTERPOLATED, CLIPPED, MISSING = Quality.GOOD, Quality.INTERPOLATED, Quality.CLIPPED, Quality.MISSING

POSITION = Channel("joint_1.position", "rad")
POWER = Channel("supply.power", "W")
MODE = Channel("mode", "1", "discrete")


def stream(*channels, rate=500.0, name="stream"):
    return Stream(name, channels, rate, "device")


def batch(of, time, values, *, source="arm", arrival=None, bound=0, quality=None):
    """Samples at ``time`` ms after EPOCH; ``values`` (n,) for all channels or (n, channels)."""
    when = EPOCH + np.rint(np.asarray(time, dtype=np.float64) * MS).astype(np.int64)
    table = np.asarray(values, dtype=np.float64)
    table = np.repeat(table[:, None], len(of.channels), axis=1) if table.ndim == 1 else table
    return Batch(
        source=source,
        stream=of,
        sequence=0,
        arrival=int(when[-1]) if arrival is None else EPOCH + round(arrival * MS),
        time=when,
        bound=np.full(len(when), bound, np.int64),
        values=table,
        quality=np.zeros(len(when), np.uint8) if quality is None else np.asarray(quality, np.uint8),
    )


def tick(at):
    return Tick(EPOCH + round(at * MS))


def joined(frames):
    """All frames in one: time in ms after EPOCH, values, quality, bound."""
    if not frames:
        return np.empty(0), np.empty((0, 9)), np.empty((0, 9), np.uint8), np.empty((0, 9), np.int64)
    return (
        (np.concatenate([f.time for f in frames]) - EPOCH) / MS,
        np.concatenate([f.values for f in frames]),
        np.concatenate([f.quality for f in frames]),
        np.concatenate([f.bound for f in frames]),
    )


def play(aligner, entries, *, flush=True):
    frames = []
    for entry in entries:
        frames += aligner.add(entry)
    return frames + (aligner.flush() if flush else [])


def one(*channels, latency=0.1, rate=500.0):
    of = stream(*channels, rate=rate)
    return Aligner({"arm": (of,)}, 50.0, latency), of


def arm_and(other, name="belt"):
    arm = stream(POSITION)
    return Aligner({"arm": (arm,), name: (other,)}, 50.0, 0.1), arm, other


def test_the_layout_names_every_column_with_the_method_in_force():
    fast, slow = stream(POSITION, POWER, MODE), stream(Channel("main.power", "W"), rate=5.0, name="slow")
    aligner = Aligner({"arm": (fast,), "supply": (slow,)}, 50.0, 0.1)
    assert [(c.name, c.unit, c.kind, c.method) for c in aligner.layout.channels] == [
        ("arm.joint_1.position", "rad", "continuous", "linear"),
        ("arm.supply.power", "W", "continuous", "average"),
        ("arm.mode", "1", "discrete", "hold"),
        ("supply.main.power", "W", "continuous", "hold"),
    ]
    assert aligner.layout.step == STEP


def test_grid_points_are_multiples_of_the_step_in_utc():
    aligner, of = one(POSITION, latency=0.1)
    t = np.arange(7, 200, 2)
    frames = play(aligner, [batch(of, t, t * 1.0)])
    time, values, quality, _ = joined(frames)
    assert np.all(np.concatenate([f.time for f in frames]) % STEP == 0)
    assert time[0] == 100  # as far back as the latency reaches from the arrival at 199
    assert np.all(quality == GOOD)
    assert values[:, 0] == pytest.approx(time)


def test_the_bound_is_the_worse_clock_bound_and_the_distance_of_the_nearer_sample():
    aligner, of = one(POSITION)
    early, late = batch(of, [19.5], [0.0], bound=700), batch(of, [20.3], [1.0], bound=900)
    _, values, _, bound = joined(play(aligner, [early, late]))
    assert values[0, 0] == pytest.approx(0.5 / 0.8)
    assert bound[0, 0] == 900 + 300_000


@pytest.mark.parametrize(
    ("missing", "quality"), [(0, GOOD), (1, INTERPOLATED), (2, INTERPOLATED), (3, MISSING), (20, MISSING)]
)
@pytest.mark.parametrize("channel", [POSITION, POWER, MODE], ids=lambda c: c.method)
def test_gaps_are_marked_and_never_filled_in_silence(channel, missing, quality):
    aligner, of = one(channel)
    t = np.delete(np.arange(1, 201, 2), slice(30, 30 + missing))  # 59 is the last before the gap
    time, values, found, bound = joined(play(aligner, [batch(of, [x], [4.0]) for x in t]))
    target = 60
    if channel.method == "hold":  # graded by the age of the sample, at the last grid point in the gap
        target = 60 + 20 * (2 * missing // 20)
        periods = (target - t[t <= target].max()) / 2
        quality = GOOD if periods <= 1.5 else INTERPOLATED if periods <= 3.5 else MISSING
    at = np.flatnonzero(time == target)[0]
    assert found[at, 0] == quality
    assert np.isnan(values[at, 0]) == (quality == MISSING)
    assert (bound[at, 0] == -1) == (quality == MISSING)
    away = (np.abs(time - target) > 10) & (time > 20) & (time < 180) & ((time < 60) | (time > 100))
    assert np.count_nonzero(away) >= 4
    assert np.all(found[away] == GOOD)


@pytest.mark.parametrize(("every", "quality"), [(8, GOOD), (2, MISSING)])
def test_a_device_that_sends_less_often_than_declared_is_in_the_frames_and_losses_are_not(every, quality):
    aligner, arm = one(POSITION)
    times = [t for t in range(0, 2000, every) if every > 2 or t % 100 < 20]
    found = joined(play(aligner, [batch(arm, [t], [1.0]) for t in times], flush=False))[2][30:, 0]
    assert (found == quality).mean() > 0.7


def test_quality_of_the_samples_used_is_merged_by_maximum():
    for channel in (POSITION, POWER):
        aligner, of = one(channel)
        t = np.arange(1, 100, 2)
        quality = np.where(t == 21, CLIPPED, GOOD)
        time, _, found, _ = joined(play(aligner, [batch(of, t, t * 1.0, quality=quality)]))
        assert found[time == 20, 0] == CLIPPED
        assert found[time == 60, 0] == GOOD


def test_nan_and_missing_samples_become_missing_values_in_their_channel_only():
    aligner, of = one(POSITION, Channel("joint_2.position", "rad"))
    values = np.array([[1.0, 1.0], [np.nan, 1.0], [1.0, 1.0]] + [[1.0, 1.0]] * 20)
    quality = np.zeros(23, np.uint8)
    quality[12] = MISSING
    t = 17 + 2 * np.arange(23)
    _, found, marks, bound = joined(play(aligner, [batch(of, t, values, quality=quality)]))
    assert marks.tolist()[:2] == [[MISSING, GOOD], [MISSING, MISSING]]
    assert np.isnan(found[0, 0])
    assert found[0, 1] == 1.0
    assert np.isnan(found[1]).all()
    assert bound[0].tolist() == [-1, MS]


def test_a_frame_is_given_out_by_the_entry_that_settles_it():
    aligner, arm, belt = arm_and(stream(Channel("speed", "m/s")))
    assert aligner.add(batch(arm, [19, 21], [1, 1], arrival=22)) == []
    assert aligner.add(batch(belt, [18], [1], source="belt", arrival=22)) == []
    (frames,) = aligner.add(batch(belt, [20], [1], source="belt", arrival=23))
    assert frames.time.tolist() == [EPOCH + 20 * MS]
    assert frames.quality.tolist() == [[GOOD, GOOD]]


def test_a_frame_does_not_wait_beyond_the_latency_and_late_samples_are_counted():
    aligner, arm, belt = arm_and(stream(Channel("speed", "m/s")))
    aligner.add(batch(arm, [19, 21], [1, 1], arrival=22))
    assert aligner.add(tick(119)) == []
    (frames,) = aligner.add(tick(120))
    assert frames.time.tolist() == [EPOCH + 20 * MS]
    assert frames.quality.tolist() == [[GOOD, MISSING]]
    assert aligner.add(batch(belt, [16, 18, 20, 22], [1] * 4, source="belt", arrival=121)) == []
    assert aligner.counts["belt", "stream"] == Counts(late=3)
    assert aligner.counts["arm", "stream"] == Counts()


def test_a_stream_that_never_speaks_stops_holding_up_the_others_and_stays_marked():
    aligner, arm, _ = arm_and(stream(Channel("speed", "m/s")))
    delays = []
    for t in range(1, 3000, 2):
        for frames in aligner.add(batch(arm, [t], [1.0])):
            assert np.all(frames.quality[:, 1] == MISSING)
            delays.append(EPOCH + t * MS - frames.time[-1])
    assert max(delays[:40]) >= 99 * MS
    assert max(delays[-40:]) <= 2 * MS


def test_streams_that_disappear_and_come_back_are_marked_in_between():
    aligner, arm, belt = arm_and(stream(Channel("speed", "m/s")))
    entries = [batch(arm, [t], [1.0]) for t in range(1, 4000, 2)]
    entries += [batch(belt, [t], [2.0], source="belt") for t in range(2, 4000, 2) if not 1000 < t < 3000]
    time, values, quality, _ = joined(play(aligner, sorted(entries, key=lambda b: b.arrival)))
    present = (time <= 1000) | (time >= 3000)
    assert np.all(quality[:, 0] == GOOD)
    assert np.all((quality[:, 1] == GOOD) == present)
    assert np.all(np.isnan(values[:, 1]) == ~present)
    assert aligner.counts["belt", "stream"].late <= 1


def test_a_slow_stream_is_held_with_its_age_in_the_bound_and_never_waited_for():
    aligner, arm, meter = arm_and(stream(Channel("main.power", "W"), rate=10.0), "meter")
    entries = [batch(arm, [t], [1.0]) for t in range(1, 2000, 2)]
    entries += [batch(meter, [t], [t], source="meter", arrival=t + 30) for t in range(0, 1000, 100)]
    frames = play(aligner, sorted(entries, key=lambda b: b.arrival), flush=False)
    time, values, quality, bound = joined(frames)
    steady = (time >= 150) & (time < 1000)
    assert np.all(quality[steady, 1] == GOOD)
    assert bound[steady, 1] == pytest.approx((time - values[:, 1])[steady] * MS)
    assert (time - values[:, 1])[steady].max() <= 130 + 20
    assert np.all(quality[(time > 1160) & (time < 1340), 1] == INTERPOLATED)
    assert np.all(quality[time > 1360, 1] == MISSING)
    assert aligner.counts["meter", "stream"].late == 0


def test_a_stream_without_a_rate_holds_until_the_age_limit():
    aligner, arm, gripper = arm_and(stream(MODE, rate=0.0), "gripper")
    entries = [batch(gripper, [0], [7.0], source="gripper"), *(batch(arm, [t], [1.0]) for t in range(1, 62_000, 20))]
    time, values, quality, _ = joined(play(aligner, entries))
    assert np.all(values[time <= 60_000, 1] == 7.0)
    assert np.all(quality[time <= 60_000, 1] == GOOD)
    assert np.all(quality[time > 60_000, 1] == MISSING) and time[-1] > 61_000


def test_samples_from_the_future_are_refused_and_counted():
    aligner, of = one(POSITION)
    frames = play(aligner, [batch(of, [1, 3], [1, 1]), batch(of, [5, 4000], [1, 1], arrival=5)], flush=False)
    assert frames == []
    frames = play(aligner, [batch(of, [t], [1.0]) for t in range(7, 101, 2)])
    assert aligner.counts["arm", "stream"] == Counts(ahead=1)
    assert np.all(joined(frames)[2] == GOOD)


def test_a_stream_whose_time_turns_back_goes_on_with_the_new_samples():
    aligner, of = one(POSITION)
    before = [batch(of, [t], [1.0]) for t in range(1, 400, 2)]
    after = [batch(of, [t], [2.0], arrival=t + 50) for t in range(351, 800, 2)]
    time, values, quality, _ = joined(play(aligner, before + after))
    assert time.tolist() == list(range(20, 800, 20))
    assert np.all(quality == GOOD)
    assert np.all(values[time > 400] == 2.0)
    counts = aligner.counts["arm", "stream"]
    assert counts.replaced > 0
    assert counts.late > 0


def test_ticks_alone_keep_the_frames_coming_when_all_streams_fell_silent():
    aligner, of = one(POSITION)
    aligner.add(batch(of, [1, 3], [1, 1]))
    time, _, quality, _ = joined(play(aligner, [tick(t) for t in range(0, 5000, 50)], flush=False))
    assert time.tolist() == list(range(20, 4851, 20))
    assert np.all(quality == MISSING)


def test_frames_after_a_jump_of_the_cell_time_by_an_hour_are_left_out_and_counted():
    aligner, of = one(POSITION)
    aligner.add(batch(of, [1, 3], [1, 1]))
    frames = aligner.add(tick(3_600_000))
    assert sum(len(f) for f in frames) == 1
    assert aligner.skipped == 3_600_000 // 20 - 5 - 1
    (frames,) = aligner.add(batch(of, [3_600_001], [1.0]))
    assert frames.time[0] == EPOCH + 3_599_920 * MS


def test_frames_go_on_with_the_samples_after_half_a_minute_in_which_nothing_came():
    aligner, of = one(POSITION)
    play(aligner, [batch(of, [1, 3], [1, 1]), *(tick(t) for t in range(20, 1000, 20))], flush=False)
    time, _, _, _ = joined(play(aligner, [batch(of, range(30_000, 30_200, 2), np.ones(100))], flush=False))
    assert time[0] == 30_000
    assert aligner.skipped == (30_000 - 900) // 20


def test_samples_of_the_last_minute_before_a_jump_of_the_cell_time_ends_are_in_frames():
    aligner, of = one(POSITION)
    aligner.add(batch(of, [1, 3], [1, 1]))
    frames = aligner.add(batch(of, range(3_550_000, 3_600_001, 10), np.ones(5001)))
    time, _, quality, _ = joined(frames)
    assert time[0] == 3_550_000
    assert np.all(quality[:-1] != MISSING)
    assert max(len(f) for f in frames) <= 512


def test_what_is_held_in_memory_does_not_grow_with_the_run():
    aligner, of = one(POSITION, POWER)
    for k in range(2000):
        aligner.add(batch(of, np.arange(100 * k, 100 * k + 100, 2), np.ones(50)))
    (lane,) = aligner._lanes.values()
    assert len(lane.track) < 100
    assert len(lane.track._time) <= 1024


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: one(POSITION, latency=0.0), "latency"),
        (lambda: one(POWER, latency=0.011), "at least 12 ms"),
        (lambda: Aligner({}, 0.0, 0.1), "rate"),
    ],
)
def test_settings_mistakes_are_refused(make, text):
    with pytest.raises(ConfigError, match=text):
        make()


# Against truth made in another way


gaps = st.lists(st.integers(1, 9_000), min_size=2, max_size=120)  # µs between samples


def reference(t, v, target, method):
    """The value at a grid point in exact arithmetic, or None outside of the samples; t, target in ns."""
    if method == "hold":
        past = [y for x, y in zip(t, v, strict=True) if x <= target]
        return past[-1] if past else None
    if method == "linear":
        return line(t, v, target)
    begin, end = target - STEP // 2, target + STEP // 2
    if t[0] > begin or t[-1] < end:
        return None
    nodes = [begin, *(x for x in t if begin < x < end), end]
    heights = [line(t, v, x) for x in nodes]
    return sum((b - a) * (x + y) / 2 for a, b, x, y in zip(nodes, nodes[1:], heights, heights[1:], strict=False)) / STEP


def line(t, v, at):
    for x, y, a, b in zip(t, t[1:], v, v[1:], strict=False):
        if x <= at <= y:
            return Fraction(a) + (Fraction(b) - Fraction(a)) * Fraction(at - x, y - x)
    return None


@settings(max_examples=30, deadline=None)
@given(gaps, st.randoms(use_true_random=False))
def test_values_equal_a_slow_reference_in_exact_arithmetic(steps, random):
    aligner, of = one(POSITION, POWER, MODE, rate=100.0)  # no gap is as long as 3.5 periods
    t = (1000 + np.cumsum(steps)) / 1000
    v = [random.uniform(-100, 100) for _ in t]
    entries = [batch(of, [a], [b]) for a, b in zip(t, v, strict=True)]
    ns = [int(e.time[0]) - EPOCH for e in entries]
    for frames in play(aligner, entries):
        for k, time in enumerate(frames.time):
            for column, method in enumerate(("linear", "average", "hold")):
                expected = reference(ns, v, int(time) - EPOCH, method)
                found = frames.values[k, column]
                assert np.isnan(found) if expected is None else found == pytest.approx(float(expected), abs=1e-9)


@st.composite
def scripts(draw):
    """Entries of three streams as they might arrive: uneven, bursty, with pauses, jumps and ticks."""
    arm, board, meter = (
        stream(POSITION, POWER, MODE),
        stream(Channel("bus.power", "W"), rate=123.0),
        stream(Channel("main.power", "W"), rate=10.0),
    )
    sources = {"arm": (arm, 2.0), "board": (board, 8.13), "meter": (meter, 100.0)}
    at = dict.fromkeys(sources, 0.0)
    entries, now = [], 0.0
    for _ in range(draw(st.integers(1, 60))):
        source = draw(st.sampled_from([*sources, "arm", "board", "tick"]))
        if source == "tick":
            now += draw(st.floats(0, 300))
            entries.append(tick(now))
            continue
        of, period = sources[source]
        at[source] += draw(st.sampled_from([0.0, 0.0, 0.0, 3 * period, 500.0, -40.0]))
        n = draw(st.integers(1, 40))
        t = at[source] + period * np.arange(1, n + 1)
        at[source] = float(t[-1])
        now = max(now, at[source] + draw(st.floats(-20, 60)))
        entries.append(
            batch(of, t, np.sin(np.outer(t, np.arange(1, len(of.channels) + 1))), source=source, arrival=now)
        )
    return {source: (of,) for source, (of, _) in sources.items()}, entries


@settings(max_examples=30, deadline=None)
@given(scripts())
def test_every_grid_point_comes_once_and_in_order_whatever_arrives(script):
    streams, entries = script
    aligner = Aligner(streams, 50.0, 0.1)
    frames, now = [], EPOCH - SECOND
    for entry in entries:
        now = max(now, entry.time if isinstance(entry, Tick) else entry.arrival)
        frames += aligner.add(entry)
        if frames:
            assert now - 100 * MS - STEP < frames[-1].time[-1] <= now
    time, values, quality, bound = joined([*frames, *aligner.flush()])
    assert np.all(np.diff(time) == 20)
    assert np.all(np.isnan(values) == (quality == MISSING))
    assert np.all((bound == -1) == (quality == MISSING))
    assert bound.min(initial=-1) >= -1


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32), st.lists(st.integers(1, 30), min_size=1, max_size=20))
def test_how_samples_are_cut_into_batches_does_not_change_a_bit_of_the_frames(seed, cuts):
    rng = np.random.default_rng(seed)
    arm, board = stream(POSITION, POWER, MODE), stream(Channel("bus.power", "W"), rate=123.0)
    whole = []
    for source, of, period in (("arm", arm, 2.0), ("board", board, 8.13)):
        for begin in np.arange(0, 600, 40.0):
            t = begin + rng.uniform(0, 1) + np.arange(0, 40, period)[:-1]
            table = rng.normal(size=(len(t), len(of.channels)))
            whole.append(batch(of, t, table, source=source, arrival=begin + 40 + rng.uniform(0, 20)))
    whole.sort(key=lambda b: b.arrival)
    pieces, turn = [], 0
    for b in whole:
        start = 0
        while start < len(b):
            end = start + cuts[turn % len(cuts)]
            part = slice(start, end)
            pieces.append(
                replace(b, time=b.time[part], bound=b.bound[part], values=b.values[part], quality=b.quality[part])
            )
            start, turn = end, turn + 1
    streams = {"arm": (arm,), "board": (board,)}
    first, second = joined(play(Aligner(streams, 50.0, 0.1), whole)), joined(play(Aligner(streams, 50.0, 0.1), pieces))
    for a, b in zip(first, second, strict=True):
        assert a.tobytes() == b.tobytes()


def test_a_mean_over_more_than_a_step_is_held_and_never_averaged_again() -> None:
    slow = Channel("supply.power", "W", window=0.05)
    fast = Channel("bus.power", "W", window=0.01)
    aligner = Aligner({"meter": (Stream("measured", (slow, fast), 100.0, "host"),)}, 50.0, 0.1)
    assert [(c.method, c.window) for c in aligner.layout.channels] == [("hold", 0.05), ("average", 0.01)]
