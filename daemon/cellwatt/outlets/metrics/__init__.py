"""Metrics of a cell for Prometheus and OpenMetrics, and probes of its health."""

from cellwatt.outlets.metrics.settings import MetricsSettings

__all__ = ["MetricsSettings"]
