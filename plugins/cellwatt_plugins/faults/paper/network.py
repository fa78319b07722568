"""Neural network that names the joint from the ternary codes of a task's intervals (Sabry et al., section V.D).

It has one input per interval, three times as many hidden neurons, one output per joint and one for "free". It is
trained by back-propagation on the columns of the task's fault table and on a column of zeros, and its largest output
decides (Table III). Training requires scikit-learn and onnx (the extra ``train``), running it onnxruntime.

A table learned from faults contains the sign of the power change (``signed``). A table made from the motion contains
only the intervals in which a joint's faults show; its network receives codes without signs.

Joints with equal columns cannot be distinguished: they share one output and are named together.

Table III prints the output code 0000101 for joint 5, whose largest output, as of "free", is Y7: by the paper's own rule
a fault of joint 5 counts as none. In this network each fault has its own output.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel

from cellwatt.arrays import Float
from cellwatt.config import reads_version
from cellwatt.errors import ConfigError, ModelError
from cellwatt_plugins.faults.criteria import Codes
from cellwatt_plugins.faults.paper.trained_for import TrainedFor
from cellwatt_plugins.onnx_file import OnnxFile

MADE_BY = ("cellwatt", "scikit-learn", "onnx")
"""Packages whose versions are stored in the file."""
HIDDEN = 3
"""Hidden neurons per interval."""
SURE = 0.95
"""Smallest output of the correct joint on its training column."""
DECAY = 1e-4
"""Weight decay of the training: small enough to learn the table, large enough to bound the weights."""
KEY = "cellwatt_fault_table"
"""Metadata of the file: the training table …"""
MADE = "cellwatt_fault_network"
"""… and the task, whether codes have signs, and how the network was made."""
VERSION = 1


def train(
    table: Codes,
    *,
    seed: int = 0,
    task: TrainedFor | None = None,
    signed: bool | None = None,
    made: Mapping[str, Any] | None = None,
) -> bytes:
    """Train a network on a fault table (intervals, joints) of -1, 0, 1; returns an ONNX file.

    Its input are codes (n, intervals), its output (n, distinct columns + 1) is from 0 to 1, the last one for "free".
    ``task`` is the task that the network applies to, ``signed`` whether the table was learned from faults
    (default: whether it contains -1), ``made`` is copied to the metadata. Raises ``ConfigError`` if scikit-learn or
    onnx is missing, ``ModelError`` if no column has a code or an output stays below ``SURE``.
    """
    try:
        from sklearn.exceptions import ConvergenceWarning  # type: ignore[import-untyped]
        from sklearn.neural_network import MLPClassifier  # type: ignore[import-untyped]

        from cellwatt_plugins.onnx_graph import Graph
    except ImportError as error:
        raise ConfigError(
            f"training the network of a fault table needs {error.name}: pip install 'cellwatt[train]'"
        ) from error
    groups = groups_of(table)
    if not groups:
        raise ModelError("fault table: no joint has a code in any interval, there is nothing to learn")
    columns = np.stack([table[:, joints[0] - 1] for joints in groups])
    inputs = np.vstack([columns, np.zeros(table.shape[0], np.int8)])
    network = MLPClassifier(
        (HIDDEN * len(table),), activation="tanh", solver="lbfgs", alpha=DECAY, max_iter=2000, random_state=seed
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # the outputs are checked below
        network.fit(inputs.astype(np.float64), np.eye(len(inputs), dtype=np.int64))
    about = {
        "version": VERSION,
        "task": None if task is None else asdict(task),
        "signed": bool((table < 0).any()) if signed is None else signed,
        "inputs": [f"interval_{number}.code" for number in range(1, len(table) + 1)],
        "outputs": [*("joint_" + "_".join(map(str, group)) for group in groups), "free"],
        "made": {**{name: version(name) for name in MADE_BY}, **(made or {})},
    }
    graph = Graph(len(table))
    (hidden, out), (hidden_bias, out_bias) = network.coefs_, network.intercepts_
    outputs = graph.op("Sigmoid", np.tanh(graph.input @ hidden + hidden_bias) @ out + out_bias)
    content = graph.model([outputs], len(inputs), {KEY: json.dumps(table.tolist()), MADE: json.dumps(about)})
    sure = np.diag(FaultNetwork(content).output_of(inputs))
    if sure.min() < SURE:
        raise ModelError(
            f"the network did not learn the fault table: its output for column {int(sure.argmin()) + 1} "
            f"is {sure.min():.2f}, expected {SURE:g} or more"
        )
    return content


class FaultNetwork(OnnxFile):
    """A trained network, run by onnxruntime, with ``intervals`` inputs and an output for each of ``groups`` and "free".

    ``groups`` are the joints (1-based) with equal columns, by the first joint of each; ``task`` is the task of the
    network, None if the file does not name one; ``signed``: its codes have signs.

    ``model`` is the file or its bytes. Raises ``ConfigError`` if onnxruntime is missing, ``ModelError`` if it cannot
    load the model, or the model is not a network of fault codes or disagrees with its metadata.
    """

    def __init__(self, model: Path | bytes) -> None:
        super().__init__(model)
        self.table = _table(self)
        self.groups = groups_of(self.table)
        self.intervals = len(self.table)
        about = self.entry(MADE, _Made)
        self.task, self.signed = about.task, about.signed
        columns = [tensor.shape[-1] for tensor in self.inputs], [tensor.shape[-1] for tensor in self.outputs]
        sizes = [self.intervals], [len(self.groups) + 1]
        if columns != sizes:
            raise self.refused(
                f"it has {columns[0]} inputs and {columns[1]} outputs, expected {sizes[0]} and {sizes[1]} for the "
                "table in its metadata"
            )

    def output_of(self, codes: Codes) -> Float:
        """Outputs Y1 … Yn and that of "free", (m, groups + 1), for the codes of m cycles (m, intervals)."""
        if codes.ndim != 2 or codes.shape[1] != self.intervals:
            raise ModelError(f"fault network: codes are {codes.shape}, expected (cycles, {self.intervals} intervals)")
        return self.run(self.cast(codes if self.signed else np.abs(codes)))

    def joints(self, codes: Codes) -> tuple[int, ...]:
        """The joints (1-based) of the largest output for one cycle's codes (intervals,); none for "free"."""
        largest = int(np.argmax(self.output_of(codes[None])[0]))
        return () if largest == len(self.groups) else self.groups[largest]


class _Made(BaseModel):
    """Metadata stored under ``MADE``."""

    version: Annotated[int, reads_version(VERSION, "train it anew, or update cellwatt")]
    task: TrainedFor | None
    signed: bool


def _table(network: OnnxFile) -> Codes:
    """The fault table in a file's metadata."""
    content = network.entry(KEY, list[list[Literal[-1, 0, 1]]])
    if len({len(row) for row in content}) != 1:
        raise network.refused(f"its table is no table of codes -1, 0 and 1: {str(content)[:60]}")
    return np.array(content, np.int8)


def groups_of(table: Codes) -> tuple[tuple[int, ...], ...]:
    """Groups of joints (1-based) with equal columns, without columns of zeros."""
    found: dict[tuple[int, ...], list[int]] = {}
    for joint, column in enumerate(table.T.tolist(), start=1):
        if any(column):
            found.setdefault(tuple(column), []).append(joint)
    return tuple(tuple(joints) for joints in found.values())
