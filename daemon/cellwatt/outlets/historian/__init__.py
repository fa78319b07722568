"""Writes a cell's history to InfluxDB and to a lake of Parquet files."""

from cellwatt.outlets.historian.settings import HistorianSettings, InfluxSettings, LakeSettings

__all__ = ["HistorianSettings", "InfluxSettings", "LakeSettings"]
