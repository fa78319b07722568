"""`cellwatt faults train` and its networks of whole motions, on a plant that shares no code with what trains them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cellwatt.errors import ModelError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.onnx_file import OnnxFile
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults.ann import training
from cellwatt_plugins.faults.ann.judging import faults_of
from cellwatt_plugins.faults.ann.network import PatternNetwork, Told
from cellwatt_plugins.faults.command import faults, reference
from cellwatt_plugins.faults.network_file import MOTION, Ends, perceptron
from cellwatt_plugins.faults.paper.stage import PaperFaultsSettings, PaperFaultsStage
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.plugins.faults.cycles.arm_of_points import RATE, Cycle, Fault, describe, run, write_table

pytestmark = pytest.mark.timeout(300)  # networks are trained once, for all tests here
HEALTHY = [Cycle(task) for task in "ABBAABBA"]
START = 1_700_000_000_000_000_000
LAYOUT = Layout(
    (
        *(FrameChannel(f"table.joint_{j}.position", "rad", "continuous", "linear") for j in range(1, 5)),
        FrameChannel("table.supply.power", "W", "continuous", "average"),
    ),
    RATE,
)
SPRING, RUBS = Fault("spring", 0, 50.0), Fault("friction", 2, 1.2)


def called(command, *arguments):
    return CliRunner().invoke(command, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cell with its reference and the networks of its two tasks; learnt from fewer cycles than usual."""
    where = tmp_path_factory.mktemp("networks")
    robot = describe(where)
    healthy = write_table(where / "reference.parquet", run(HEALTHY, seed=1))
    learned = called(reference, healthy, "--robot", robot, "--out", where / "reference.yaml")
    assert learned.exit_code == 0, learned.output
    calm = write_table(where / "calm.parquet", run([Cycle(task) for task in "ABAB"], seed=9))
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("CYCLES", 5000), ("HELD", 1500), ("CALM", 2000)):
            patch.setattr(training, name, value)
        done = called(
            faults, "train", calm, "--reference", where / "reference.yaml", "--robot", robot, "--out", where / "nets",
            "--seed", 1, "--json",
        )  # fmt: skip
    assert done.exit_code == 0, done.output or done.exception
    (where / "report.json").write_text(done.stdout)
    return where


def watch(folder, cycles, seed=5, block=20, network="nets"):
    """The alarms of a network, by the cycle that raised them, and those of the thresholds."""
    measured = run(cycles, seed=seed)
    cell = CellInfo("plant", "cell", None, folder)
    segment = SegmentStage("segment", SegmentSettings(), LAYOUT, cell)
    chosen = PaperFaultsSettings(reference=Path("reference.yaml"), network=Path(network))
    stage = PaperFaultsStage("faults", chosen, LAYOUT, cell)
    values = np.column_stack([measured.position, measured.power])
    time = START + np.round(measured.time * 1e9).astype(np.int64)
    alarms = []
    for i in range(0, len(time), block):
        part = slice(i, i + block)
        shape = values[part].shape
        frames = Frames(LAYOUT, i, time[part], values[part], np.zeros(shape, np.uint8), np.zeros(shape, np.int64))
        alarms += stage.process(frames, segment.process(frames, ()))
    alarms += stage.close()
    return [a for a in alarms if ".network." in a.id], [a for a in alarms if ".network." not in a.id]


def named(alarms):
    return {(alarm.joint, alarm.kind) for alarm in alarms if alarm.active}


@pytest.mark.parametrize(
    ("faulty", "expected"),
    [
        (Cycle("B", faults=(SPRING,)), {(1, "joint_fault")}),
        pytest.param(Cycle("A", faults=(RUBS,)), {(3, "joint_fault")}, marks=pytest.mark.slow),
        pytest.param(
            Cycle("B", 1.03, faults=(Fault("friction", 1, 1.2),)), {(2, "joint_fault")}, marks=pytest.mark.slow
        ),
        (Cycle("A", faults=(SPRING, Fault("friction", 3, 1.5))), {(1, "joint_fault"), (4, "joint_fault")}),
        pytest.param(Cycle("A", faults=(Fault("drive_cut", 1),)), {(2, "joint_fault")}, marks=pytest.mark.slow),
        (Cycle("B", faults=(Fault("encoder_offset", 2, 0.1),)), {(3, "encoder_fault")}),
        (Cycle("A", faults=(Fault("drive_cut", 1), Fault("drive_cut", 0))), {(1, "joint_fault"), (2, "joint_fault")}),
    ],
)
def test_faults_of_one_joint_or_two_are_named_at_the_end_of_the_cycle_and_cleared(folder, faulty, expected):
    told, _ = watch(folder, [Cycle("A"), faulty, Cycle("B"), Cycle("A")])
    assert named(told) == expected
    raised = {alarm.id for alarm in told if alarm.active}
    assert {alarm.id for alarm in told if not alarm.active} == raised
    first = next(alarm for alarm in told if alarm.active)
    assert {"task", "speed", "power_residual_W", "confidence"} <= first.evidence.keys()


def test_what_is_harmless_is_none_for_the_network_though_it_is_for_the_thresholds(folder):
    harmless = [
        Cycle("A", pause=2.0),
        Cycle("B", 1.04),
        Cycle("A", warmth=0.15),
        Cycle("B", part=0.1),
        Cycle("A", 0.62),
    ]
    told, thresholds = watch(folder, harmless)
    assert named(told) == set()
    assert named(thresholds) != set()


def test_blocks_of_any_size_give_the_same(folder):
    cycles = [Cycle("A", faults=(RUBS,)), Cycle("B")]
    expected, _ = watch(folder, cycles)
    assert expected
    for block in (3, 5000):
        assert [(a.id, a.active, a.since) for a in watch(folder, cycles, block=block)[0]] == [
            (a.id, a.active, a.since) for a in expected
        ]


def test_the_report_says_what_each_network_is_and_counts_alarms_in_vain(folder):
    networks = json.loads((folder / "report.json").read_text())["networks"]
    codes = [n for n in networks if n["kind"] == "codes"]
    motions = [n for n in networks if n["kind"] == "motion"]
    assert [n["task"] for n in codes] == [n["task"] for n in motions] == ["task_1", "task_2"]
    assert sum(n["healthy_cycles"] for n in motions) == 4
    assert sum(n["named_in_vain"] for n in motions) == 0
    assert all(c == {"origin": "simulated", "cycles": 3} for n in codes for c in n["columns"])
    assert all(np.array(n["table"]).any(axis=0).sum() >= 3 for n in codes)


def test_a_recording_is_judged_by_the_network_too(folder, tmp_path):
    judged = write_table(tmp_path / "today.parquet", run([Cycle("A"), Cycle("B", faults=(SPRING,))], seed=5))
    known = ["--reference", folder / "reference.yaml"]
    done = called(faults, judged, *known, "--network", folder / "nets", "--json")
    assert done.exit_code == 0, done.exception
    cycles = json.loads(done.stdout)["cycles"]
    assert [[(f["joint"], f["kind"]) for f in cycle["faults"]] for cycle in cycles] == [[], [(1, "joint")]]
    for given in ([], ["--network", folder / "nets", "--robot", folder / "robot.yaml"]):
        assert "give one of --robot and --network" in str(called(faults, judged, *known, *given).exception)
    only_codes = next((folder / "nets").glob("*-codes.onnx"))
    assert "has codes only" in str(called(faults, judged, *known, "--network", only_codes).exception)


def test_the_file_says_what_it_is(folder):
    file = next((folder / "nets").glob("*1.00-motion.onnx"))
    network = PatternNetwork(OnnxFile(file))
    head = network.head
    assert (head.joints, head.outputs[0], head.outputs[-1]) == (4, "joint_1", "any_joint")
    assert head.inputs[0] == "move_1.part_1.power"
    assert {"cellwatt", "scikit-learn", "onnx", "seed"} <= head.made.keys()


def test_a_network_of_another_reference_is_refused(folder, tmp_path):
    measured = run(HEALTHY, seed=2, noise=2.0)
    other = write_table(tmp_path / "other.parquet", measured)
    done = called(reference, other, "--robot", folder / "robot.yaml", "--out", tmp_path / "reference.yaml")
    assert done.exit_code == 0
    file = next((folder / "nets").glob("task_1-1.00-motion.onnx"))
    (tmp_path / "net.onnx").write_bytes(file.read_bytes())
    with pytest.raises(ModelError, match=r"net\.onnx: was trained for task_1 .* none of reference .*another healthy"):
        watch(tmp_path, [Cycle("A")], network="net.onnx")


def test_a_network_of_a_motion_needs_a_reference_with_whole_cycles(folder, tmp_path):
    called(reference, folder / "reference.parquet", "--out", tmp_path / "reference.yaml")
    done = called(
        faults, "train", "--reference", tmp_path / "reference.yaml", "--robot", folder / "robot.yaml",
        "--kind", "motion", "--out", tmp_path / "nets",
    )  # fmt: skip
    assert isinstance(done.exception, ModelError)
    assert "needs whole cycles: learn the reference with --robot" in str(done.exception)
    file = next((folder / "nets").glob("task_1-1.00-motion.onnx"))
    (tmp_path / "net.onnx").write_bytes(file.read_bytes())
    with pytest.raises(ModelError, match=r"judges whole cycles, and reference .* has none"):
        watch(tmp_path, [Cycle("A")], network="net.onnx")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"version": 2}, "its metadata is wrong: version"),
        ({"outputs": ["a"]}, "its graph has .* expected"),
        ({"limit": 7}, "its metadata is wrong: limit"),
    ],
)
def test_a_file_that_contradicts_itself_is_refused(folder, content, reason):
    head = json.loads(
        json.dumps(OnnxFile(next((folder / "nets").glob("*1.00-motion.onnx"))).metadata(MOTION, dict))
    ) | content  # fmt: skip
    layers = [(np.zeros((len(head["inputs"]), 3)), np.zeros(3)), (np.zeros((3, 9)), np.zeros(9))]
    made = perceptron(layers, ("Asinh", "Sigmoid"), Ends("motion", "faults"), "x", {MOTION: head})
    with pytest.raises(ModelError, match=reason):
        PatternNetwork(OnnxFile(made))


def test_it_says_that_it_cannot_tell(known):
    pattern = known.patterns[0]
    watts = np.zeros(8 * len(pattern.moves) + len(pattern.moves) + 1)
    watts[3] = 12.0
    nothing = np.zeros(4)
    between = Told(np.array([0.4, 0.05, 0.45, 0.0]), nothing, 0.97, watts, nothing)
    (fault,) = faults_of(between, 0.9, pattern)
    assert (fault.joint, fault.alternatives, fault.intervals) == (0, (1, 3), (1,))
    assert "cannot be told of which joint: joint 1 or 3" in fault.statement
    assert faults_of(replace(between, any_joint=0.8), 0.9, pattern) == ()
    off = replace(between, off=np.array([0.0, 0.1, 0.0, 0.0]), any_joint=0.2)
    (open_kind,) = faults_of(
        replace(off, joints=np.array([0, 0.4, 0, 0]), encoders=np.array([0, 0.3, 0, 0])), 0.9, pattern
    )
    assert (open_kind.joint, open_kind.or_kind is None) == (2, False)
