"""Writes a cell's history elsewhere: to InfluxDB, and into a lake of Parquet files."""

from cellwatt.sinks.historian.settings import HistorianSettings, InfluxSettings, LakeSettings

__all__ = ["HistorianSettings", "InfluxSettings", "LakeSettings"]
