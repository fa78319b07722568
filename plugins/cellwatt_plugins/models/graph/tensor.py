"""Formulas written once with numpy, for arrays and for ONNX graphs: a ``Tensor`` turns ufuncs into nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from cellwatt_plugins.models.graph.builder import Graph

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
        names = [each.name if isinstance(each, Tensor) else np.asarray(each, np.float64) for each in inputs]
        return Tensor(self.graph, self.graph.op(_NODES[ufunc], *names))

    def sum(self, axis: int = -1, keepdims: bool = False) -> Tensor:
        """Sum along an axis, as of an array."""
        return Tensor(self.graph, self.graph.sum(self.name, axis, keepdims))


def beside(parts: Sequence[Any]) -> Any:
    """Columns (N, …) of arrays, or of tensors, side by side along the last axis."""
    first = parts[0]
    if isinstance(first, Tensor):
        return Tensor(first.graph, first.graph.concat([part.name for part in parts]))
    return np.concatenate(parts, axis=-1)


def pick(x: Any, column: int) -> Any:
    """One column (N, 1) of an array or a tensor (N, n)."""
    if isinstance(x, Tensor):
        return Tensor(x.graph, x.graph.slice(x.name, column, column + 1))
    return x[:, [column]]
