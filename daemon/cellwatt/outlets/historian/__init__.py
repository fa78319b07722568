"""Writes a cell's history elsewhere: to InfluxDB, and into a lake of Parquet files."""

from cellwatt.outlets.historian.settings import HistorianSettings, InfluxSettings, LakeSettings

__all__ = ["HistorianSettings", "InfluxSettings", "LakeSettings"]
