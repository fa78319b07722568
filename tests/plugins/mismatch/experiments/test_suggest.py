"""Experiments: their limits, their choice, and that they tell apart what the recordings could not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cellwatt_plugins.mismatch.command import explain as explain_command
from cellwatt_plugins.mismatch.experiments.expected_evidence import ExpectedEvidence
from cellwatt_plugins.mismatch.experiments.expected_motion import expected_states, velocity_spread
from cellwatt_plugins.mismatch.experiments.library import arm_experiments, joint_experiments, loaded_poses
from cellwatt_plugins.mismatch.experiments.limits import Limits, limits_of
from cellwatt_plugins.mismatch.experiments.objectives import Detection, Discrimination
from cellwatt_plugins.mismatch.experiments.suggest import Suggestion, suggest, suggestion_in_words, write_suggestion
from cellwatt_plugins.mismatch.experiments.trajectory import Trajectory, harmonics, move, replay
from cellwatt_plugins.mismatch.explain import Explained, explain
from cellwatt_plugins.mismatch.fit.problem import Term
from cellwatt_plugins.mismatch.input.baseline import baseline
from cellwatt_plugins.mismatch.input.reading import read_motion
from cellwatt_plugins.mismatch.input.run import Motion
from cellwatt_plugins.mismatch.model import predict
from cellwatt_plugins.robot.effects import BY_NAME
from tests.plugins.mismatch.slow_and_loaded import arm, program, recorded
from tests.plugins.robot import planar_arm

LOAD, STRIBECK = "load_dependent_friction", "stribeck_friction"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("arm")


@pytest.fixture(scope="module")
def explained(folder) -> Explained:
    return explain(runs := [recorded(program(), LOAD)], baseline(runs, arm(folder)))


@pytest.fixture(scope="module")
def suggested(explained) -> Suggestion:
    return suggest(explained)


def share(found: Explained, true: str, other: str) -> float:
    """Share of the true name's evidence that the other reaches, at most."""
    return 1 - margin(found, true, other) / found.torque.rivals[(true, 0)][0]


def margin(found: Explained, true: str, other: str) -> float:
    """Evidence of the true name at the shoulder beyond that of the other, at least."""
    own, rivals = found.torque.rivals[(true, 0)]
    named = [c.gain for c in rivals if c.term.place == (other, 0)]
    return own - (named[0] if named else rivals[-1].gain)


def steadily(motion: Motion) -> None:
    """Velocity and acceleration are the position's derivatives; both ends are at rest."""
    step = motion.time[1] - motion.time[0]
    for level, rate in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        numeric = (level[2:] - level[:-2]) / (2 * step)
        assert np.max(np.abs(numeric - rate[1:-1])) < 0.02 * np.max(np.abs(rate)) + 1e-3
    for end in (0, -1):
        assert np.allclose(motion.velocity[end], 0, atol=1e-9)


def room(lower=(-2.0, -1.0), upper=(2.0, 1.0), velocity=(1.5, 2.5), acceleration=(3.0, 8.0), home=(0.3, -0.2)):
    low, high, v, a, here = (np.array(x) for x in (lower, upper, velocity, acceleration, home))
    return Limits(low, high, v, a, np.full(2, np.inf), here, low + 0.05, high - 0.05)


bounded = st.floats(-1.9, 1.9)


class TestTrajectory:
    @settings(max_examples=60, deadline=None)
    @given(st.tuples(bounded, bounded), st.tuples(bounded, bounded), st.sampled_from([0.002, 0.1, np.inf]))
    @example((0.0, 0.0), (0.0, 1e-9), 0.002)
    def test_move_keeps_limits_and_arrives(self, start, end, speed):
        limits = room(lower=(-2, -2), upper=(2, 2))
        pieces = move(np.array(start), np.array(end), limits, speed)
        if not pieces:
            assert np.allclose(start, end)
            return
        motion = Trajectory(pieces).sampled(max(Trajectory(pieces).seconds / 3000, 1e-5))
        assert np.allclose(motion.position[0], start)
        assert np.allclose(motion.position[-1], end)
        assert np.all(np.abs(motion.velocity) <= np.minimum(limits.cruise, speed) * (1 + 1e-6))
        assert np.all(np.abs(motion.acceleration) <= limits.ramp * (1 + 1e-6))

    def test_move_takes_no_longer_than_it_must(self):
        limits = room()
        motion = Trajectory(move(np.array([-1.0, 0.0]), np.array([1.0, 0.0]), limits)).sampled(0.001)
        assert np.max(np.abs(motion.velocity[:, 0])) == pytest.approx(limits.cruise[0], rel=1e-3)
        assert np.max(np.abs(motion.acceleration[:, 0])) == pytest.approx(limits.ramp[0], rel=1e-3)

    def test_derivatives_of_a_move(self):
        steadily(Trajectory(move(np.array([-1.0, 0.4]), np.array([1.0, -0.3]), room())).sampled(0.002))

    @pytest.mark.parametrize("seed", range(4))
    def test_harmonics_fill_what_is_allowed(self, seed):
        limits = room()
        motion = Trajectory((harmonics(limits, 60.0, seed),)).sampled(0.005)
        steadily(motion)
        used = [
            np.max(np.abs(motion.position - (limits.low + limits.high) / 2), axis=0) / ((limits.high - limits.low) / 2),
            np.max(np.abs(motion.velocity), axis=0) / limits.cruise,
            np.max(np.abs(motion.acceleration), axis=0) / limits.ramp,
        ]
        assert np.all(np.max(used, axis=0) < 1.0)
        assert np.all(np.max(used, axis=0) > 0.9)

    @pytest.mark.parametrize("speed", [1.0, 0.3])
    def test_replay_starts_and_ends_at_rest_though_the_motion_does_not(self, speed):
        time = np.arange(0, 12, 0.01)
        position = np.column_stack([np.sin(time), np.cos(0.7 * time)])
        flow = Motion(time, position, np.gradient(position, 0.01, axis=0), np.zeros_like(position))
        motion = Trajectory((replay(flow, speed),)).sampled(0.01)
        steadily(motion)
        assert np.allclose(motion.position[0], position[0])
        assert np.allclose(motion.position[-1], position[-1], atol=1e-3)
        middle = np.abs(motion.velocity[:, 0])
        assert np.max(middle) == pytest.approx(speed, rel=0.02)


class TestLimits:
    def test_description_goes_before_urdf(self, explained):
        limits = limits_of(explained.torque.problem.states)
        assert limits.velocity.tolist() == [2.0, 3.0]
        assert limits.lower.tolist() == [-0.2, -3.0]
        assert limits.upper.tolist() == [1.9, 3.0]

    def test_recorded_motion_keeps_them(self, explained):
        states = explained.torque.problem.states
        motion = Motion(states[0].time, states[0].q, states[0].qd, states[0].qdd)
        assert limits_of(states).broken(motion, states[0].torque) is None

    @pytest.mark.parametrize(
        ("name", "change"),
        [("position", (3.0, 0.0, 0.0)), ("velocity", (0.0, 4.0, 0.0)), ("acceleration", (0.0, 0.0, 99.0))],
    )
    def test_broken_ones_are_named(self, name, change):
        still = np.zeros((3, 2))
        motion = Motion(np.arange(3.0), *(still + np.array([0.0, x]) for x in change))
        assert room().broken(motion, still) == f"joint 2 would break its {name} limit"

    def test_loaded_poses_span_the_load(self, explained):
        states = explained.torque.problem.states
        load = planar_arm.gravity(np.array(loaded_poses(limits_of(states), states, 0)))[:, 0]
        assert np.max(np.abs(load)) > 40
        assert np.min(np.abs(load)) < 2

    def test_every_experiment_keeps_them_and_returns_home(self, explained):
        states = explained.torque.problem.states
        limits = limits_of(states)
        library = arm_experiments(limits, states) + [e for j in (0, 1) for e in joint_experiments(limits, states, j)]
        assert len({e.name for e in library}) == 13
        for experiment in library:
            motion = experiment.trajectory.sampled(0.02)
            torque = planar_arm.torque(motion.position, motion.velocity, motion.acceleration)
            assert limits.broken(motion, 0 * torque) is None, experiment.name
            assert np.allclose(motion.position[[0, -1]], limits.home), experiment.name
            assert np.allclose(motion.velocity[[0, -1]], 0), experiment.name
            assert np.max(np.abs(np.diff(motion.position, axis=0))) < 0.021 * 3, experiment.name


class TestExpectedEvidence:
    def test_velocity_is_known_as_well_as_in_the_recordings(self, explained):
        (states,) = explained.torque.problem.states
        known = velocity_spread([states])
        expected = expected_states(
            "again", Motion(states.time, states.q, states.qd, states.qdd), explained.model, [states]
        )
        assert np.all(known < 0.01)
        slow = np.abs(states.qd[:, 0]) < 0.001
        assert np.median(expected.moved.sign_spread[slow, 0]) == pytest.approx(
            np.median(states.moved.sign_spread[slow, 0]), abs=0.05
        )

    def test_effect_that_the_motion_does_not_show_is_not_ruled_out(self, explained):
        now = ExpectedEvidence(explained.torque, None)
        shown = now.against(Term(BY_NAME["spring_load"], 0, ()), np.array([5.0, 5.0]))
        hidden = now.against(Term(BY_NAME[LOAD], 1, ()), np.array([0.5]))
        assert shown > 20
        assert hidden < 8

    def test_a_name_leads_its_rival_where_it_is_true(self, explained):
        term, rival = (Term(BY_NAME[name], 0, shape) for name, shape in ((LOAD, ()), (STRIBECK, (0.4,))))
        (states,) = explained.torque.problem.states
        wide = harmonics(limits_of([states]), 40.0)
        more = expected_states("wide", Trajectory((wide,)).sampled(0.02), explained.model, [states])
        evidence = ExpectedEvidence(explained.torque, more)
        assert evidence.lead(term, rival) > 20
        assert evidence.lead(rival, term) > 16  # the evidence that a name is asked for


class TestSuggestion:
    def test_recordings_leave_two_names_open(self, explained):
        (finding,) = explained.findings.findings
        assert (finding.effect, finding.joint) == (LOAD, 1)
        assert (STRIBECK, 1) in {(a.effect, a.joint) for a in finding.alternatives}

    def test_question_is_which(self, suggested):
        (chosen,) = suggested.chosen
        assert {type(a.objective) for a in chosen.gains} == {Discrimination}
        assert not suggested.open

    @pytest.mark.parametrize(
        ("true", "other", "factor"),
        [(LOAD, STRIBECK, 4.0), pytest.param(STRIBECK, LOAD, 1.5, marks=pytest.mark.slow)],
    )
    def test_suggested_motion_tells_what_the_program_could_not(self, folder, suggested, true, other, factor):
        """Both plants run the suggested motion, the program, and the program as often as fills the same time."""
        length = suggested.motion.time[-1]
        again = program(int(np.ceil(length / program().time[-1])))
        assert again.time[-1] > 0.9 * length
        motions = (suggested.motion, program(), again)
        told, once, repeated = (
            explain(runs := [recorded(m, true, seed=5)], baseline(runs, arm(folder))) for m in motions
        )
        assert [(f.effect, f.joint) for f in told.findings.findings] == [(true, 1)]
        assert not told.findings.findings[0].alternatives
        assert margin(told, true, other) > factor * margin(once, true, other)
        assert share(told, true, other) < 0.8 * share(repeated, true, other)

    def test_expected_evidence_comes_true_with_both_recordings(self, folder, explained, suggested):
        first = recorded(program(), LOAD)
        both = explain(runs := [first, recorded(suggested.motion, LOAD, "run_02", 5)], baseline(runs, arm(folder)))
        expected = suggested.chosen[0].gains[0].nats
        gained = margin(both, LOAD, STRIBECK) - margin(explained, LOAD, STRIBECK)
        assert gained > 0.5 * expected

    def test_limits_are_kept(self, folder, suggested):
        motion = suggested.motion
        joint = arm(folder).description.joints[0]
        assert joint.lower_limit <= np.min(motion.position[:, 0])
        assert np.max(motion.position[:, 0]) <= joint.upper_limit
        assert np.all(np.max(np.abs(motion.velocity), axis=0) <= [2.0, 3.0])
        steadily(suggested.chosen[0].experiment.trajectory.sampled(0.001))

    def test_csv_reads_back_as_a_motion(self, folder, suggested, tmp_path):
        path = tmp_path / "deep" / "experiment.csv"
        write_suggestion(suggested.motion, path)
        header = path.read_text().splitlines()[0]
        assert header == "t,q_1,q_2,qd_1,qd_2,qdd_1,qdd_2"
        run, read = read_motion(path, None, arm(folder).description)
        assert np.allclose(read.position, suggested.motion.position, atol=1e-6)
        assert np.allclose(read.velocity, suggested.motion.velocity, atol=1e-6)
        assert np.allclose(read.acceleration, suggested.motion.acceleration, atol=1e-6)
        assert run.step == pytest.approx(0.01)

    def test_words_say_what_how_long_and_what_for(self, suggested):
        words = suggestion_in_words(suggested, Path("next.csv"))
        assert "tell load dependent friction at joint 1 from stribeck friction at joint 1" in words
        assert "95 % sure after about" in words
        assert "next.csv" in words
        assert "rad/s" in words

    def test_joint_that_hardly_moved_is_to_be_moved(self, folder):
        found = explain(runs := [recorded(program(), None)], baseline(runs, arm(folder)))
        suggestion = suggest(found)
        asked = {(a.objective.term.effect.name, a.objective.term.joint) for c in suggestion.chosen for a in c.gains}
        assert all(isinstance(a.objective, Detection) for c in suggestion.chosen for a in c.gains)
        assert (STRIBECK, 1) in asked
        assert (STRIBECK, 0) not in asked
        assert np.ptp(suggestion.motion.position[:, 1]) > 0.5

    def test_warming_takes_its_time(self, folder):
        suggestion = suggest(explain(runs := [recorded(program(), None)], baseline(runs, arm(folder))))
        warm = [c for c in suggestion.chosen for a in c.gains if "temperature" in a.objective.aim]
        assert warm
        assert all(c.experiment.trajectory.seconds > 100 and c.seconds >= 100 for c in warm)


def test_command_writes_the_motion_and_says_so(folder, tmp_path):
    arm(folder)
    run = recorded(program(), LOAD)
    columns = {"t": run.time}
    for name, values in (("q", run.position), ("tau", run.torque)):
        columns |= {f"{name}_{i + 1}": values[:, i] for i in range(2)}
    pq.write_table(pa.table(columns), tmp_path / "run_01.recording.parquet")
    plan = {"t": run.time}
    for name, values in (("q", run.plan.position), ("qd", run.plan.velocity), ("qdd", run.plan.acceleration)):
        plan |= {f"{name}_{i + 1}": values[:, i] for i in range(2)}
    pq.write_table(pa.table(plan), tmp_path / "run_01.simulation.parquet")
    words = [str(tmp_path / "run_01.recording.parquet"), "--simulation", str(tmp_path / "run_01.simulation.parquet")]
    words += ["--suggest", str(tmp_path / "next.csv"), "--robot", str(folder / "robot.yaml")]
    done = CliRunner().invoke(explain_command, [*words, "--out", str(tmp_path / "out"), "--no-report"])
    assert done.exit_code == 0, done.output
    assert "suggested: " in done.output
    motion, _ = read_motion(tmp_path / "next.csv", None, arm(folder).description)
    assert len(motion.time) > 1000
    assert np.allclose(np.diff(motion.time), 0.01)


def test_suggested_motion_can_be_simulated(explained, suggested):
    predicted = predict(explained.model, suggested.motion)
    assert predicted.torque.shape == suggested.motion.position.shape
    assert np.all(np.isfinite(predicted.torque))
