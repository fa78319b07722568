"""Networks of faults as ONNX files, written from trained layers."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError

Float = NDArray[np.float64]
Layers = Sequence[tuple[Float, Float]]
"""Weights (inputs, outputs) and bias (outputs,) of each layer."""

OPSET, IR_VERSION = 17, 8
"""Old enough for every onnxruntime that cellwatt takes."""
MADE_BY = ("cellwatt", "scikit-learn", "onnx")
"""Packages whose versions stand in a file."""


@dataclass(frozen=True, slots=True)
class Ends:
    """Names of the tensors that go in and come out."""

    given: str
    found: str


def versions() -> dict[str, str]:
    """Versions of the packages that a network is made with."""
    return {name: version(name) for name in MADE_BY}


def perceptron(layers: Layers, active: Sequence[str], ends: Ends, name: str, properties: Mapping[str, Any]) -> bytes:
    """An ONNX file of layers, float32, each followed by the ONNX operator ``active`` (Tanh, Sigmoid, Asinh).

    ``properties`` become its metadata, as JSON. Raises ``ConfigError`` where onnx is missing.
    """
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise ConfigError(f"writing a network of faults needs onnx ({error}): pip install 'cellwatt[train]'") from error
    labels = [*(f"hidden{'' if len(layers) == 2 else f'_{k}'}" for k in range(1, len(layers))), "output"]
    numbers: list[Any] = []
    nodes: list[Any] = []
    tensor = ends.given
    for (weights, bias), operator, label in zip(layers, active, labels, strict=True):
        pair = [f"{label}_weights", f"{label}_bias"]
        numbers += [
            numpy_helper.from_array(np.asarray(v, np.float32), n) for v, n in ((weights, pair[0]), (bias, pair[1]))
        ]
        after = ends.found if label == "output" else f"{label}_active"
        nodes += [helper.make_node("Gemm", [tensor, *pair], [label]), helper.make_node(operator, [label], [after])]
        tensor = after
    sizes = {ends.given: len(layers[0][0]), ends.found: layers[-1][0].shape[1]}
    tensors = [helper.make_tensor_value_info(n, TensorProto.FLOAT, ["cycles", size]) for n, size in sizes.items()]
    graph = helper.make_graph(nodes, name, tensors[:1], tensors[1:], initializer=numbers)
    opset = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="cellwatt")
    helper.set_model_props(model, {key: json.dumps(value) for key, value in properties.items()})
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))
