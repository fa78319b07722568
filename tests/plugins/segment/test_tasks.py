import pytest

from cellwatt.results import Interval
from cellwatt_plugins.segment.tasks import TaskRecogniser, signature

SECOND = 10**9
A = [{1: 0.9}, {3: -0.7}, {2: 0.35, 3: 0.2}, {1: -0.9}, {2: -0.35, 3: 0.5}]
B = [{2: -0.4}, {1: 0.3, 2: 0.4}, {1: -0.3}]


class World:
    """Intervals at rest and in motion, one after the other."""

    def __init__(self, before=()):
        """Begin with the arm where the moves ``before`` lead."""
        self.pose = [at + sum(by.get(j, 0.0) for by in before) for j, at in enumerate((0.0, -1.0, 0.5), start=1)]
        self.time = 0
        self.intervals = []
        self.add({}, 1.0, complete=False)

    def add(self, by, seconds, *, complete=True):
        way = tuple(by.get(j, 0.0) for j in (1, 2, 3))
        start, self.time = self.time, self.time + round(seconds * SECOND)
        speed = tuple(abs(w) / seconds * 1.9 for w in way)
        number, pose = len(self.intervals) + 1, tuple(self.pose)
        interval = Interval(
            "arm", number, start, self.time, tuple(by), way, pose, speed, closed=True, complete=complete
        )
        self.intervals.append(interval)
        self.pose = [p + w for p, w in zip(self.pose, way, strict=True)]

    def run(self, moves, times=1, *, seconds=0.8, rest=0.3, last=0.8, extra=None, noise=0.0, lost=None):
        """Repetitions; ``extra`` index → more rest after that move, ``lost`` the index of a move with lost data."""
        for index, by in times * [*enumerate(moves)]:
            self.add({j: w + noise for j, w in by.items()}, seconds, complete=index != lost)
            self.pose = [p - noise * (j + 1 in by) for j, p in enumerate(self.pose)]
            self.add({}, (last if index == len(moves) - 1 else rest) + (extra or {}).get(index, 0.0))
        return self


def recognise(world):
    recogniser = TaskRecogniser()
    return [task for interval in world.intervals for task in recogniser.update(interval)]


def numbers(world, task):
    moves = [i for i in world.intervals if i.number in task.intervals and i.moving]
    return [dict(zip(i.moving, (round(i.displacement[j - 1], 2) for j in i.moving), strict=True)) for i in moves]


def test_a_cycle_is_found_when_it_has_run_twice_and_then_each_time():
    world = World().run(A, 5)
    tasks = recognise(world)
    assert [t.repetition for t in tasks] == [1, 2, 3, 4, 5]
    assert tasks[0].start == world.intervals[1].start
    assert tasks[0].signature == signature([i for i in world.intervals if i.moving][: len(A)])


@pytest.mark.parametrize("late", [0, 3])
def test_without_a_longest_rest_it_still_begins_at_the_same_move(late):
    world = World(A[:late]).run(A[late:] + A[:late], 4, last=0.3)
    first = {numbers(world, t)[0].popitem() for t in recognise(world)}
    assert first == {(1, 0.9)}


@pytest.mark.parametrize(
    ("world", "count"),
    [
        (World().run(A).run(A, extra={1: 5.0}).run(A, extra={0: 2.0, 3: 1.0}).run(A), 4),
        (World().run(A, 2).run(A[:2], last=0.3).run([{1: -0.9, 3: 0.7}], seconds=1.0, last=2.0).run(A, 2), 4),
        (World().run(A, 2).run(A, last=0.3, lost=2).run(A), 3),
    ],
    ids=["pauses", "an interrupted repetition", "lost data"],
)
def test_only_whole_repetitions_count_with_whatever_pauses(world, count):
    tasks = recognise(world)
    assert [t.repetition for t in tasks] == list(range(1, count + 1))
    assert all(numbers(world, t) == A for t in tasks)


def test_speed_makes_a_variant():
    world = World().run(A, 2).run(A, seconds=0.8 / 0.6, rest=0.5).run(A, seconds=0.81).run(A, seconds=0.8 / 0.6)
    tasks = recognise(world)
    assert {t.name for t in tasks} == {"task_1"}
    assert [t.variant for t in tasks] == ["speed=1.00", "speed=1.00", "speed=0.60", "speed=1.00", "speed=0.60"]
    assert tasks[2].speed == pytest.approx(0.6, abs=0.01)


def test_another_task_in_between_is_found_too():
    world = World().run(A, 2).run(B).run(A).run(B, 2).run(A)
    tasks = sorted(recognise(world), key=lambda t: t.start)
    assert [t.name for t in tasks] == ["task_1", "task_1", "task_2", "task_1", "task_2", "task_2", "task_1"]
    assert all(numbers(world, t) == (A if t.name == "task_1" else B) for t in tasks)


def test_strict_alternation_is_one_task_until_its_parts_recur_alone():
    world = World().run(A).run(B, last=1.5).run(A).run(B)
    assert [len(numbers(world, t)) for t in recognise(world)] == [len(A) + len(B)] * 2
    world.run(A, 2).run(B)
    last = recognise(world)[-1]
    assert numbers(world, last) == A or numbers(world, last) == B


def test_the_same_step_again_and_again_is_no_task_while_the_arm_goes_on():
    assert recognise(World().run([{1: 0.3}], 6, seconds=0.5, last=0.4)) == []


def test_the_signature_is_the_same_in_any_session():
    moves = [{1: 0.7853981, 2: 0.3926991}, {1: -0.7853981, 2: -0.3926991}]
    found = {t.signature for noise in (-0.0005, 0.0, 0.0005) for t in recognise(World().run(moves, 2, noise=noise))}
    assert found == {"1+45,2+22 1-45,2-23"}


def test_memory_stays_bounded():
    recogniser = TaskRecogniser()
    world = World()
    for k in range(900):
        world.add({1: 0.1 + 0.001 * (k % 677)}, 0.5)
    for interval in world.intervals:
        recogniser.update(interval)
    assert len(recogniser._moves) <= 512


@pytest.mark.parametrize("late", range(len(A)))
def test_it_begins_after_the_longest_rest_wherever_the_data_begin(late):
    world = World(A[:late]).run(A[late:]).run(A, 3)
    tasks = recognise(world)
    assert len(tasks) == 3 + (late == 0)
    assert all(numbers(world, t) == A for t in tasks)
