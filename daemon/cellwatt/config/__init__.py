"""Settings: one YAML file a cell, checked whole before anything connects."""

from cellwatt.config.cell import CellConfig, FrameSettings, SinkConfig, SourceConfig, StageConfig
from cellwatt.config.loading import load
from cellwatt.config.public import public_config
from cellwatt.config.schema import json_schema

__all__ = [
    "CellConfig",
    "FrameSettings",
    "SinkConfig",
    "SourceConfig",
    "StageConfig",
    "json_schema",
    "load",
    "public_config",
]
