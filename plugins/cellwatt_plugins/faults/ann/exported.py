"""A trained network of a motion as an ONNX file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellwatt_plugins.faults.ann.bins import Bins
from cellwatt_plugins.faults.ann.network import ENDS, VERSION, digest
from cellwatt_plugins.faults.ann.training import FALSE_ALARMS, Trained
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.network_file import MOTION, perceptron, versions


def exported(trained: Trained, pattern: Pattern, made: Mapping[str, Any] | None = None) -> bytes:
    """A trained network as an ONNX file with its metadata; ``made`` is added to it. Raises ``ConfigError``."""
    bins = Bins(pattern)
    weights, bias = trained.layers[-1]
    layers = [
        (trained.white, -trained.mean @ trained.white),
        *trained.layers[:-1],
        (weights / trained.temperature, bias / trained.temperature),
    ]
    joints = range(1, bins.joints + 1)
    head = {
        "version": VERSION,
        "task": pattern.task,
        "speed": pattern.speed,
        "reference": digest(pattern),
        "joints": bins.joints,
        "inputs": bins.names,
        "outputs": [*(f"joint_{j}" for j in joints), *(f"encoder_{j}" for j in joints), "any_joint"],
        "limit": round(trained.limit, 4),
        "false_alarms": FALSE_ALARMS,
        "made": {**versions(), "held_out_log_loss": round(trained.loss, 4), **(made or {})},
    }
    active = ["Asinh", *["Tanh"] * (len(layers) - 2), "Sigmoid"]
    return perceptron(layers, active, ENDS, "faults_over_a_motion", {MOTION: head})
