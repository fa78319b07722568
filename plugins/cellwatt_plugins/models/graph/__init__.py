"""ONNX graphs that contain the physics of a robot, so that a model file needs no other file."""

from cellwatt_plugins.models.graph.builder import Graph
from cellwatt_plugins.models.graph.chain import Chain
from cellwatt_plugins.models.graph.dynamics import inverse_dynamics
from cellwatt_plugins.models.graph.tensor import Tensor, beside, pick

__all__ = ["Chain", "Graph", "Tensor", "beside", "inverse_dynamics", "pick"]
