"""Runs exported models (ONNX) on the frames, and refuses models that do not fit the cell."""

from cellwatt_plugins.models.describe import describe, read_metadata
from cellwatt_plugins.models.metadata import Input, Metadata, Output, Training
from cellwatt_plugins.models.stage import ModelSettings, ModelStage

__all__ = ["Input", "Metadata", "ModelSettings", "ModelStage", "Output", "Training", "describe", "read_metadata"]
