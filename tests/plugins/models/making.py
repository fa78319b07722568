"""Small models with known weights, cells for them, and frames."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from onnxruntime import InferenceSession

from cellwatt import Alarm, CellInfo, Frames, Layout, Prediction, Result
from cellwatt.frames import cut
from cellwatt_plugins.models import Input, Metadata, ModelSettings, ModelStage, Output, Training
from cellwatt_plugins.models.metadata import KEY, encode
from cellwatt_plugins.onnx_graph import Graph, Tensor
from tests.blocks import frames_of, layout_of

RATE = 50.0
START = 1_800_000_000_000_000_000
CHANNELS = {
    "arm.joint_1.position": "rad",
    "arm.joint_2.position": "rad",
    "arm.joint_1.velocity": "rad/s",
    "meter.supply.power": "W",
    "meter.supply.voltage": "V",
}
INPUTS = ("supply.voltage", "joint_1.position", "joint_2.position")
"""Not in the order of the columns."""
COLUMNS = [4, 0, 1]


def layout(channels: dict[str, str] = CHANNELS, rate: float = RATE) -> Layout:
    return layout_of(channels, rate)


def frames(values: NDArray[np.float64], grid: Layout | None = None) -> Frames:
    grid = grid or layout()
    return frames_of(grid, 0, START + grid.step * np.arange(len(values)), values)


def split(block: Frames, at: Sequence[int]) -> list[Frames]:
    """The same frames in other blocks."""
    return [cut(block, a, b) for a, b in pairwise([0, *sorted(at), len(block)])]


def metadata(**changes: Any) -> Metadata:
    units = {name.split(".", 1)[1]: unit for name, unit in CHANNELS.items()}
    inputs = changes.pop("inputs", tuple(Input(name, units[name]) for name in INPUTS))
    training = Training(
        data="ab" * 32, range=((-4.0, 4.0),) * len(inputs), created=datetime(2026, 5, 4, tzinfo=UTC), rows=1000
    )
    given = {"name": "test-power", "robot": "ur10e", "rate_hz": RATE, "training": training}
    outputs = (Output("power", "W"), Output("heat", "J"))
    return Metadata(**given | {"inputs": inputs, "outputs": outputs} | changes)


@dataclass(frozen=True)
class Mlp:
    """``tanh(x·a + b)·c + d`` on the inputs, or on all values of a window, and its truth in numpy."""

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    d: NDArray[np.float64]
    window: int = 1

    @classmethod
    def random(cls, seed: int, inputs: int = 3, hidden: int = 16, outputs: int = 2, window: int = 1) -> Mlp:
        rng = np.random.default_rng(seed)
        # Exact in float32, so that both precisions have the same weights.
        shapes = ((inputs * window, hidden), (hidden,), (hidden, outputs), (outputs,))
        return cls(*(rng.integers(-64, 65, shape) / 64 for shape in shapes), window)

    def truth(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outputs (n, outputs) of inputs (n, inputs) or (n, window, inputs)."""
        return np.tanh(x.reshape(len(x), -1) @ self.a + self.b) @ self.c + self.d

    def save(self, path: Path, told: Metadata | str | None, dtype: type[np.floating[Any]] = np.float32) -> Path:
        kind = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
        weights = [numpy_helper.from_array(getattr(self, n).astype(dtype), n) for n in "abcd"]
        inputs = len(self.a) // self.window
        weights.append(numpy_helper.from_array(np.array([-1, len(self.a)]), "flat"))
        nodes = [
            helper.make_node("Reshape", ["x", "flat"], ["v"]),
            helper.make_node("MatMul", ["v", "a"], ["va"]),
            helper.make_node("Add", ["va", "b"], ["vab"]),
            helper.make_node("Tanh", ["vab"], ["h"]),
            helper.make_node("MatMul", ["h", "c"], ["hc"]),
            helper.make_node("Add", ["hc", "d"], ["y"]),
        ]
        x = tensor("x", ["n", *([self.window] if self.window > 1 else []), inputs], kind)
        return save(path, nodes, [x], [tensor("y", ["n", len(self.d)], kind)], told, weights)


def tensor(name: str, shape: Sequence[int | str], kind: int = TensorProto.FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)


def save(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    inputs: Sequence[onnx.ValueInfoProto],
    outputs: Sequence[onnx.ValueInfoProto],
    told: Metadata | str | None,
    weights: Sequence[onnx.TensorProto] = (),
) -> Path:
    graph = helper.make_graph(list(nodes), "graph", list(inputs), list(outputs), list(weights))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if told is not None:
        helper.set_model_props(model, {KEY: encode(told) if isinstance(told, Metadata) else told})
    onnx.save(model, path)
    return path


def undated(path: Path) -> bytes:
    """A model file without the time at which it was made."""
    return re.sub(rb'"created":"[^"]+"', b"", path.read_bytes(), count=1)


def stage(path: Path, grid: Layout | None = None, robot: str | None = "ur10e", **settings: Any) -> ModelStage:
    cell = CellInfo("plant", "cell", robot, path.parent)
    # Not checked by pydantic, so that a file that has gone since reaches the stage.
    given = ModelSettings.model_construct(**{"file": path, "source": None, "outside": 0.05, **settings})
    return ModelStage("power", given, grid or layout(), cell)


def run_graph(graph: Graph, output: Tensor, columns: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ``output`` with so many columns of a graph."""
    session = InferenceSession(graph.model([output], columns), providers=["CPUExecutionProvider"])
    return np.asarray(session.run(None, {"input": values})[0])


def run(made: ModelStage, blocks: Iterable[Frames]) -> list[Result]:
    return [result for block in blocks for result in made.process(block, ())]


def outputs(results: Sequence[Result]) -> NDArray[np.float64]:
    """All predictions (frames, outputs)."""
    found = [p for p in results if isinstance(p, Prediction)]
    return np.concatenate([np.column_stack([p.outputs[n] for n in ("power", "heat")]) for p in found])


def alarms(results: Sequence[Result]) -> list[Alarm]:
    return [a for a in results if isinstance(a, Alarm)]
