"""The neural network that names the joint from the ternary codes of a task's intervals (Sabry et al., section V.D).

As many inputs as intervals, three times as many hidden neurons, one output for each joint and one more for "free".
It is trained by back-propagation on the columns of the task's fault table and on a column of zeros, and decides by
its largest output (Table III). Training needs scikit-learn and onnx (the extra ``train``), running it onnxruntime.

Joints whose columns are the same cannot be told apart: they share one output and are named together.

Table III prints for joint 5 the output code 0000101, which is also that of "free": the largest output of both its
rows is Y7, so by the paper's own rule a fault of joint 5 is taken as none. Here each fault has one output of its own.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError, ModelError
from cellwatt.files import check_file

Float = NDArray[np.float64]
Codes = NDArray[np.int8]

HIDDEN = 3
"""Hidden neurons for each interval."""
SURE = 0.95
"""What the right output reaches on the column that it was trained on."""
DECAY = 1e-4
"""Weight decay of the training: small enough that the table is learnt, large enough that weights stay bounded."""
OPSET, IR_VERSION = 17, 8
"""Old enough for every onnxruntime that cellwatt takes."""
KEY = "cellwatt_fault_table"
"""Metadata of the file: the table that it was trained on."""


def train(table: Codes, *, seed: int = 0) -> bytes:
    """A network for a fault table (intervals, joints) of -1, 0, 1, as an ONNX file.

    Input ``codes`` (n, intervals) float32, output ``joints`` (n, distinct columns + 1) from 0 to 1, the last one for
    "free". Raises ``ConfigError`` where scikit-learn or onnx is missing, ``ModelError`` where no column has a code or
    the training does not reach ``SURE`` on each.
    """
    groups = _groups(table)
    if not groups:
        raise ModelError("fault table: no joint has a code in any interval, there is nothing to learn")
    columns = np.stack([table[:, joints[0] - 1] for joints in groups])
    inputs = np.vstack([columns, np.zeros(table.shape[0], np.int8)]).astype(np.float64)
    layers = _trained(inputs, np.eye(len(inputs)), seed)
    sure = np.diag(_forward(layers, inputs))
    if sure.min() < SURE:
        raise ModelError(
            f"the network did not learn the fault table: its output for column {int(sure.argmin()) + 1} "
            f"is {sure.min():.2f}, expected {SURE:g} or more"
        )
    return _exported(layers, table, len(inputs))


class FaultNetwork:
    """A trained network, run by onnxruntime; ``intervals`` inputs, an output for each of ``groups`` and for "free".

    ``groups`` are the joints (from 1) with one column each, in the order of the first of them.

    ``model`` is the file or its bytes. Raises ``ConfigError`` where onnxruntime is missing, ``ModelError`` where it
    cannot load the model or the model is not one of fault codes.
    """

    def __init__(self, model: Path | bytes) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise ConfigError(
                f"the network of fault tables needs onnxruntime ({error}): pip install 'cellwatt[model]'"
            ) from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4  # what goes wrong is raised
        source = str(model) if isinstance(model, Path) else model
        where = f"fault network {model}" if isinstance(model, Path) else "fault network"
        try:
            if isinstance(model, Path):
                check_file(model)
            self._session = onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])
            self.table: Codes = np.array(json.loads(self._session.get_modelmeta().custom_metadata_map[KEY]), np.int8)
        except KeyError as error:
            raise ModelError(f"{where}: has no metadata {KEY!r}: it was not made from a fault table") from error
        except Exception as error:  # onnxruntime raises types of its own, not of one family
            raise ModelError(f"{where}: onnxruntime cannot load it: {str(error).splitlines()[0]}") from error
        self.intervals = len(self.table)
        self.groups = _groups(self.table)

    def outputs(self, codes: Codes) -> Float:
        """Y1 … Yn and the one for "free", (m, groups + 1), for the codes of m cycles (m, intervals)."""
        if codes.ndim != 2 or codes.shape[1] != self.intervals:
            raise ModelError(f"fault network: codes are {codes.shape}, expected (cycles, {self.intervals} intervals)")
        found = self._session.run(["joints"], {"codes": codes.astype(np.float32)})[0]
        return np.asarray(found, dtype=np.float64)

    def joints(self, codes: Codes) -> tuple[int, ...]:
        """The joints (from 1) of the largest output for one cycle's codes (intervals,); none for "free"."""
        largest = int(np.argmax(self.outputs(codes[None])[0]))
        return () if largest == len(self.groups) else self.groups[largest]


def _groups(table: Codes) -> tuple[tuple[int, ...], ...]:
    """Joints (from 1) whose columns are the same, without those that have no code at all."""
    found: dict[tuple[int, ...], list[int]] = {}
    for joint, column in enumerate(table.T.tolist(), start=1):
        if any(column):
            found.setdefault(tuple(column), []).append(joint)
    return tuple(tuple(joints) for joints in found.values())


def _trained(inputs: Float, targets: Float, seed: int) -> list[tuple[Float, Float]]:
    """Weights and biases of the hidden layer (tanh) and of the output layer (logistic)."""
    try:
        from sklearn.exceptions import ConvergenceWarning  # type: ignore[import-untyped]
        from sklearn.neural_network import MLPClassifier  # type: ignore[import-untyped]
    except ImportError as error:
        raise ConfigError(
            f"training the network of a fault table needs scikit-learn ({error}): pip install 'cellwatt[train]'"
        ) from error
    network = MLPClassifier(
        (HIDDEN * inputs.shape[1],), activation="tanh", solver="lbfgs", alpha=DECAY, max_iter=2000, random_state=seed
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # whether it learnt is checked on its outputs
        network.fit(inputs, targets.astype(np.int64))
    return list(zip(network.coefs_, network.intercepts_, strict=True))


def _forward(layers: list[tuple[Float, Float]], inputs: Float) -> Float:
    (first, bias), (second, offset) = layers
    return np.asarray(1 / (1 + np.exp(-(np.tanh(inputs @ first + bias) @ second + offset))))


def _exported(layers: list[tuple[Float, Float]], table: Codes, outputs: int) -> bytes:
    """The layers as an ONNX graph with the table in its metadata."""
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise ConfigError(
            f"writing the network of a fault table needs onnx ({error}): pip install 'cellwatt[train]'"
        ) from error
    names = (("hidden_weights", "hidden_bias"), ("output_weights", "output_bias"))
    numbers = [
        numpy_helper.from_array(np.asarray(value, np.float32), name)
        for layer, pair in zip(layers, names, strict=True)
        for value, name in zip(layer, pair, strict=True)
    ]
    nodes: list[Any] = [
        helper.make_node("Gemm", ["codes", *names[0]], ["hidden"]),
        helper.make_node("Tanh", ["hidden"], ["active"]),
        helper.make_node("Gemm", ["active", *names[1]], ["sums"]),
        helper.make_node("Sigmoid", ["sums"], ["joints"]),
    ]
    tensors = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["cycles", size])
        for name, size in (("codes", len(table)), ("joints", outputs))
    ]
    graph = helper.make_graph(nodes, "fault_table", tensors[:1], tensors[1:], initializer=numbers)
    opset = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="cellwatt")
    helper.set_model_props(model, {KEY: json.dumps(table.tolist())})
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))
