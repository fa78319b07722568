"""ONNX graphs written node by node: names are generated, numbers are float64."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cellwatt.errors import CellwattError

try:
    import onnx
    from onnx import TensorProto, helper, numpy_helper
except ImportError as error:
    raise CellwattError(
        f"making a model needs onnx ({error}): install it with pip install 'cellwatt[train]'"
    ) from error

OPSET: Final = 17
IR_VERSION: Final = 8
"""Old enough for every onnxruntime that cellwatt takes."""


class Graph:
    """A graph with one input and one output tensor; tensors are identified by their names.

    ``columns`` is the size of the input's last axis, ``window`` that of the one before it where it is above 1.
    """

    def __init__(self, columns: int, window: int = 1) -> None:
        self.input: Final = "input"
        self._shape: list[str | int | None] = ["N", columns] if window == 1 else ["N", window, columns]
        self._nodes: list[Any] = []
        self._constants: dict[tuple[str, tuple[int, ...], bytes], str] = {}
        self._initializers: list[Any] = []

    def constant(self, value: ArrayLike) -> str:
        """Numbers in the graph, float64; integers stay int64 (shapes, axes, indices). Equal constants are stored
        once."""
        array = np.asarray(value)
        array = np.ascontiguousarray(array, np.int64 if array.dtype.kind in "iu" else np.float64).reshape(array.shape)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._constants:
            name = self._constants[key] = f"c{len(self._constants)}"
            self._initializers.append(numpy_helper.from_array(array, name))
        return self._constants[key]

    def op(self, kind: str, *inputs: str | ArrayLike, **attributes: Any) -> str:
        """Add a node with one output and return the output's name; an input that is not a name becomes a constant."""
        return self.ops(kind, 1, *inputs, **attributes)[0]

    def ops(self, kind: str, outputs: int, *inputs: str | ArrayLike, **attributes: Any) -> list[str]:
        """The same for a node with several outputs."""
        names = [each if isinstance(each, str) else self.constant(each) for each in inputs]
        made = [f"{kind.lower()}{len(self._nodes)}" + (f"_{i}" if outputs > 1 else "") for i in range(outputs)]
        self._nodes.append(helper.make_node(kind, names, made, name=made[0], **attributes))
        return made

    def reshape(self, x: str, shape: Sequence[int]) -> str:
        """The tensor in another shape; one axis may be −1, for the remaining size."""
        return self.op("Reshape", x, np.array(shape, np.int64))

    def slice(self, x: str, start: int, stop: int, axis: int = -1) -> str:
        """x[start:stop] along an axis."""
        return self.op("Slice", x, *(np.array([each], np.int64) for each in (start, stop, axis)))

    def concat(self, parts: Sequence[str], axis: int = -1) -> str:
        """Tensors side by side along an axis."""
        return self.op("Concat", *parts, axis=axis)

    def sum(self, x: str, axis: int = -1, keep: bool = False) -> str:
        """Sum along an axis."""
        return self.op("ReduceSum", x, np.array([axis], np.int64), keepdims=int(keep))

    def model(self, output: str, columns: int) -> bytes:
        """The finished graph as an ONNX file: input (N, …) float64, output (N, ``columns``) float64."""
        nodes = [*self._nodes, helper.make_node("Identity", [output], ["output"], name="output")]
        used = {name for node in nodes for name in node.input}
        graph = helper.make_graph(
            nodes,
            "cellwatt",
            [helper.make_tensor_value_info(self.input, TensorProto.DOUBLE, self._shape)],
            [helper.make_tensor_value_info("output", TensorProto.DOUBLE, ["N", columns])],
            initializer=[each for each in self._initializers if each.name in used],
        )
        opset = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="cellwatt")
        onnx.checker.check_model(model)
        return bytes(model.SerializeToString(deterministic=True))
