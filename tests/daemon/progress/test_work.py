"""Stages inside one another: what is told, how far it is, and how long it takes yet."""

from __future__ import annotations

import pytest

from cellwatt.progress import Told, Work, aside, listening, stage, steps
from tests.daemon.progress.screens import Clock, Noting


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def work(clock):
    with listening(Work(Noting(), clock)) as work:
        yield work


def test_a_loop_in_a_loop(work, clock):
    told = []
    for _ in steps(range(5), "fold"):
        for _ in steps(["a", "b"], "epoch"):
            told.append(work.told())
            clock.now += 3.0
    assert told[0] == Told("fold 1 of 5, epoch 1 of 2", 0.0, None)
    # Half of the second of five folds: 3 of 10 epochs of 3 s.
    assert told[3].text == "fold 2 of 5, epoch 2 of 2"
    assert told[3].fraction == pytest.approx(0.3)
    assert told[3].left == pytest.approx(21.0)
    assert work.told() is None


def test_a_label(work):
    told = [work.told().text for _ in steps(["spring load", "backlash"], "trying", str)]
    assert told == ["trying spring load (1 of 2)", "trying backlash (2 of 2)"]


def test_a_loop_of_unknown_length_has_no_figures(work, clock):
    for i in steps(iter("ab"), "part"):
        clock.now += 1.0
        assert work.told() == Told(f"part {'ab'.index(i) + 1}", None, None)


def test_stages_do_their_share_of_what_is_around_them(work, clock):
    with stage("", 100.0):
        with stage("reading", 1, share=20.0):
            clock.now = 1.0
        assert work.told() == Told("", 0.2, pytest.approx(4.0))
        with stage("writing", 8, share=80.0) as told:
            told.advance(2, "writing frames")
            assert work.told() == Told("writing frames", pytest.approx(0.4), pytest.approx(1.5))


def test_what_is_inside_a_stage_of_unknown_length_counts_for_nothing(work):
    with stage("searching"):
        for _ in steps(range(2), "trying"):
            assert work.told().fraction is None


def test_more_than_expected_is_never_more_than_all(work, clock):
    with stage("reading", 10) as told:
        clock.now = 2.0
        told.advance(15)
        assert work.told() == Told("reading", 1.0, 0.0)


def test_a_mistake_inside_ends_all_stages(work):
    with pytest.raises(ValueError, match="broken"), stage("outer"):
        for _ in steps(range(3), "inner"):
            raise ValueError("broken")
    assert work.told() is None
    assert work.screen.calls == ["begin", "end"]


def test_a_loop_that_is_left_early_ends_its_stage(work):
    with stage("outer"):
        for _ in steps(range(3), "inner"):
            break
        assert work.told().text == "outer"


def test_a_generator_that_is_read_in_turns_with_another(work):
    """Two readers at once, each with a stage of its own; the one that began first ends first."""

    def read(name):
        with stage(name):
            yield 1

    first, second = read("first"), read("second")
    next(first), next(second)
    assert work.told().text == "first, second"
    first.close()
    second.close()
    assert work.told() is None


def test_nobody_listens():
    assert list(steps(iter("abc"), "letter")) == ["a", "b", "c"]
    with stage("reading", 3) as told, aside():
        told.advance()
    assert told.done == 1


def test_output_of_another_kind_is_written_aside(work):
    with stage("replaying"), aside():
        pass
    assert work.screen.calls == ["begin", "aside", "end"]
