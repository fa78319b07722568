"""Metrics of a cell for Prometheus and OpenMetrics."""

from cellwatt.outlets.metrics.settings import MetricsSettings

__all__ = ["MetricsSettings"]
