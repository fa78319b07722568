"""ONNX graphs from formulas: numpy's operators and ufuncs on a ``Tensor`` add nodes; numbers are float64."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import onnx
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import ArrayLike
from onnx import TensorProto, helper, numpy_helper

OPSET: Final = 17
IR_VERSION: Final = 8
"""Old enough for every onnxruntime that cellwatt takes."""

_NODES: Final[dict[Any, str]] = {
    np.absolute: "Abs",
    np.add: "Add",
    np.cos: "Cos",
    np.divide: "Div",
    np.exp: "Exp",
    np.matmul: "MatMul",
    np.maximum: "Max",
    np.minimum: "Min",
    np.multiply: "Mul",
    np.negative: "Neg",
    np.power: "Pow",
    np.sin: "Sin",
    np.subtract: "Sub",
    np.tanh: "Tanh",
}
"""Ufuncs that can be traced, and the ONNX operator of each; both broadcast alike."""


class Tensor(NDArrayOperatorsMixin):
    """A tensor of a graph, for numpy's operators and ufuncs: ``np.tanh(x / width) * weight`` adds nodes."""

    def __init__(self, graph: Graph, name: str) -> None:
        self.graph = graph
        self.name = name

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options or ufunc not in _NODES:
            return NotImplemented
        given = (each if isinstance(each, Tensor) else np.asarray(each, np.float64) for each in inputs)
        return self.graph.op(_NODES[ufunc], *given)

    def sum(self, axis: int = -1, keepdims: bool = False) -> Tensor:
        """Sum along an axis, as of an array."""
        return self.graph.op("ReduceSum", self, [axis], keepdims=int(keepdims))

    def reshape(self, *shape: int) -> Tensor:
        """The tensor in another shape; one axis may be −1, for the remaining size."""
        return self.graph.op("Reshape", self, shape)

    def transpose(self, *axes: int) -> Tensor:
        """The tensor with its axes in another order."""
        return self.graph.op("Transpose", self, perm=axes)

    def part(self, start: int, stop: int, axis: int = -1) -> Tensor:
        """x[start:stop] along an axis."""
        return self.graph.op("Slice", self, [start], [stop], [axis])

    def split(self, sizes: Sequence[int], axis: int) -> list[Tensor]:
        """Parts of these ``sizes`` along an axis."""
        return self.graph.ops("Split", len(sizes), self, sizes, axis=axis)


class Graph:
    """A graph with one input tensor, float64.

    ``columns`` is the size of the input's last axis, ``window`` that of the one before it where it is above 1.
    """

    def __init__(self, columns: int, window: int = 1) -> None:
        self.input: Final = Tensor(self, "input")
        self._shape: list[str | int | None] = ["N", columns] if window == 1 else ["N", window, columns]
        self._nodes: list[Any] = []
        self._constants: dict[tuple[str, tuple[int, ...], bytes], str] = {}
        self._initializers: list[Any] = []

    def op(self, kind: str, *inputs: Tensor | ArrayLike, **attributes: Any) -> Tensor:
        """Add a node with one output and return the output; an input that is no tensor becomes a constant."""
        return self.ops(kind, 1, *inputs, **attributes)[0]

    def ops(self, kind: str, outputs: int, *inputs: Tensor | ArrayLike, **attributes: Any) -> list[Tensor]:
        """The same for a node with several outputs."""
        names = [each.name if isinstance(each, Tensor) else self._constant(each) for each in inputs]
        made = [f"{kind.lower()}{len(self._nodes)}" + (f"_{i}" if outputs > 1 else "") for i in range(outputs)]
        self._nodes.append(helper.make_node(kind, names, made, name=made[0], **attributes))
        return [Tensor(self, name) for name in made]

    def _constant(self, value: ArrayLike) -> str:
        """Numbers in the graph, float64; integers stay int64 (shapes, axes, indices). Equal constants are stored
        once."""
        array = np.asarray(value)
        array = np.ascontiguousarray(array, np.int64 if array.dtype.kind in "iu" else np.float64).reshape(array.shape)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._constants:
            name = self._constants[key] = f"c{len(self._constants)}"
            self._initializers.append(numpy_helper.from_array(array, name))
        return self._constants[key]

    def model(self, parts: Sequence[Tensor], columns: int, properties: Mapping[str, str] | None = None) -> bytes:
        """The finished graph as an ONNX file: input (N, …), and ``parts`` (N, …) side by side, with so many
        ``columns``; ``properties`` are its metadata."""
        whole = parts[0] if len(parts) == 1 else beside(parts)
        nodes = [*self._nodes, helper.make_node("Identity", [whole.name], ["output"], name="output")]
        used = {name for node in nodes for name in node.input}
        graph = helper.make_graph(
            nodes,
            "cellwatt",
            [helper.make_tensor_value_info(self.input.name, TensorProto.DOUBLE, self._shape)],
            [helper.make_tensor_value_info("output", TensorProto.DOUBLE, ["N", columns])],
            initializer=[each for each in self._initializers if each.name in used],
        )
        opset = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="cellwatt")
        helper.set_model_props(model, dict(properties or {}))
        onnx.checker.check_model(model)
        return bytes(model.SerializeToString(deterministic=True))


def beside(parts: Sequence[Any]) -> Any:
    """Columns (N, …) of arrays, or of tensors, side by side along the last axis."""
    first = parts[0]
    if isinstance(first, Tensor):
        return first.graph.op("Concat", *parts, axis=-1)
    return np.concatenate(parts, axis=-1)
