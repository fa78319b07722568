"""Metrics of a cell for Prometheus and OpenMetrics, and health probes."""

from cellwatt.outlets.metrics.settings import MetricsSettings

__all__ = ["MetricsSettings"]
