"""Formulas traced into a graph against the same formulas on arrays."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.onnx_graph import Graph
from tests.plugins.models.making import run_graph


def test_a_formula_gives_the_same_as_an_array_and_as_a_graph():
    weights = np.array([[1.0, -2.0], [0.5, 0.0], [3.0, 1.0]])

    def formula(x):
        y = np.tanh(x / 0.3) * np.exp(-(x * x)) + np.maximum(x, 0.0) - 2.0 * np.minimum(-x, np.abs(x))
        return (np.sin(x) + np.cos(y)) @ weights + y.sum(axis=-1, keepdims=True)

    graph = Graph(columns=3)
    values = np.random.default_rng(1).normal(size=(20, 3))
    found = run_graph(graph, formula(graph.input), 2, values)
    assert np.abs(found - formula(values)).max() < 1e-12


def test_what_has_no_node_is_refused():
    graph = Graph(columns=1)
    with pytest.raises(TypeError):
        np.arctan(graph.input)
