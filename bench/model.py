"""The model stage on one frame a call (12 inputs, 100 hidden neurons), beside a bare call of onnxruntime.

    python bench/model.py --json

The stage takes its inputs out of 60 columns, looks for missing ones, runs the model, watches the training range and
makes the ``Prediction``; the bare call is handed a ready float32 array. Both run in turn, in one thread, on the same
frames.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from cellwatt import CellInfo, FrameChannel, Frames, Layout
from cellwatt_plugins.models import Input, Metadata, ModelSettings, ModelStage, Output, Training, describe

COLUMNS, INPUTS, HIDDEN, WINDOW, RATE = 60, 12, 100, 10, 50.0
BUDGET_US = 100.0


def write_model(path: Path, window: int) -> None:
    """An MLP with random weights, trained on nothing."""
    rng = np.random.default_rng(1)
    shapes = {"a": (INPUTS * window, HIDDEN), "b": (HIDDEN,), "c": (HIDDEN, 1), "d": (1,)}
    weights = [numpy_helper.from_array(rng.normal(0, 0.1, s).astype(np.float32), n) for n, s in shapes.items()]
    weights.append(numpy_helper.from_array(np.array([-1, INPUTS * window]), "flat"))
    steps = [("Reshape", "x", "flat"), ("MatMul", "0", "a"), ("Add", "1", "b"), ("Tanh", "2")]
    steps += [("MatMul", "3", "c"), ("Add", "4", "d")]
    nodes = [helper.make_node(op, names, [str(i)]) for i, (op, *names) in enumerate(steps)]
    shape = ["n", window, INPUTS] if window > 1 else ["n", INPUTS]
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, shape)
    y = helper.make_tensor_value_info("5", TensorProto.FLOAT, ["n", 1])
    graph = helper.make_graph(nodes, "mlp", [x], [y], weights)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    told = Metadata(
        name="bench",
        robot=None,
        inputs=tuple(Input(f"joint_{i}.position", "rad") for i in range(1, INPUTS + 1)),
        outputs=(Output("power", "W"),),
        rate_hz=RATE,
        window=window,
        training=Training.of(np.repeat([[-5.0], [5.0]], INPUTS, axis=1)),
    )
    describe(path, told)


def make_frames(count: int) -> list[Frames]:
    """Blocks of one frame."""
    names = [f"arm.joint_{i}.position" for i in range(1, COLUMNS + 1)]
    layout = Layout(tuple(FrameChannel(n, "rad", "continuous", "linear") for n in names), RATE)
    values = np.random.default_rng(2).uniform(-4, 4, (count, 1, COLUMNS))
    still = np.zeros((1, COLUMNS), dtype=np.int64)
    quality = still.astype(np.uint8)
    return [Frames(layout, i, np.array([i * layout.step]), v, quality, still) for i, v in enumerate(values)]


def stage_call(path: Path, frames: list[Frames]) -> Callable[[int], object]:
    stage = ModelStage("bench", ModelSettings(file=path), frames[0].layout, CellInfo("a", "b", None, path.parent))
    return lambda i: stage.process(frames[i], ())


def bare_call(path: Path, frames: list[Frames], window: int) -> Callable[[int], object]:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    values = np.concatenate([f.values[:, :INPUTS] for f in frames]).astype(np.float32)
    padded = np.concatenate([values[: window - 1], values])
    ready = [padded[i : i + window] if window > 1 else padded[i] for i in range(len(frames))]
    given = [np.ascontiguousarray(x[np.newaxis]) for x in ready]
    return lambda i: session.run(None, {"x": given[i]})


def measure(call: Callable[[int], object], count: int) -> dict[str, float]:
    """Time of one call, µs, and of this process's CPU alone, which other processes do not stretch."""
    spent = np.empty(count)
    before = time.process_time_ns()
    for i in range(count):
        start = time.perf_counter_ns()
        call(i)
        spent[i] = time.perf_counter_ns() - start
    cpu = (time.process_time_ns() - before) / count * 1e-3
    p50, p99, p999 = (float(p) for p in np.percentile(spent, [50, 99, 99.9]) * 1e-3)
    return {"p50_us": p50, "cpu_us": cpu, "mean_us": float(spent.mean() * 1e-3), "p99_us": p99, "p999_us": p999}


def spread(runs: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Median, least and greatest of each figure over the repeats."""
    found = {name: [run[name] for run in runs] for name in runs[0]}
    return {
        name: {"median": round(float(np.median(v)), 2), "min": round(min(v), 2), "max": round(max(v), 2)}
        for name, v in found.items()
    }


def bench(calls: int, repeats: int) -> dict[str, object]:
    frames = make_frames(calls)
    result: dict[str, object] = {
        "inputs": INPUTS,
        "hidden": HIDDEN,
        "calls": calls,
        "repeats": repeats,
        "budget_us": BUDGET_US,
        "onnxruntime": onnxruntime.__version__,
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, window in (("frame", 1), (f"window_{WINDOW}", WINDOW)):
            path = Path(folder) / f"{name}.onnx"
            write_model(path, window)
            sides: dict[str, list[dict[str, float]]] = {"cellwatt": [], "plain_onnxruntime": []}
            for _ in range(repeats + 1):
                sides["cellwatt"].append(measure(stage_call(path, frames), calls))
                sides["plain_onnxruntime"].append(measure(bare_call(path, frames, window), calls))
            result[name] = {side: spread(runs[1:]) for side, runs in sides.items()}  # the first only warms up
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--calls", type=int, default=20_000, help="frames of each run")
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    result = bench(options.calls, options.repeats)
    if options.json:
        print(json.dumps(result, indent=2))
        return
    for name in ("frame", f"window_{WINDOW}"):
        for side, figures in result[name].items():
            print(name, side)
            for figure, found in figures.items():
                print(f"  {figure:8} {found['median']:8.2f}  ({found['min']:.2f} … {found['max']:.2f})")


if __name__ == "__main__":
    main()
