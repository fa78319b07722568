"""Settings: one YAML file per cell, checked completely before anything connects."""

from cellwatt.config.cell import CellConfig, FrameSettings, OutletConfig, SourceConfig, StageConfig
from cellwatt.config.loading import load
from cellwatt.config.places import KeyPath
from cellwatt.config.public import public_config
from cellwatt.config.schema import json_schema
from cellwatt.config.settings_file import Check, read_settings, reads_version

__all__ = [
    "CellConfig",
    "Check",
    "FrameSettings",
    "KeyPath",
    "OutletConfig",
    "SourceConfig",
    "StageConfig",
    "json_schema",
    "load",
    "public_config",
    "read_settings",
    "reads_version",
]
