"""Metrics as text, in the format that a reader asks for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from cellwatt.outlets.metrics.catalogue import CATALOGUE, Family
from cellwatt.outlets.metrics.meter import Meter, Sample


class CellCollector(Collector):
    """Gives the families of a meter; ``constant`` labels are on each series."""

    def __init__(self, meter: Meter, constant: Mapping[str, str]) -> None:
        self._meter, self._constant = meter, dict(constant)

    def collect(self) -> Iterator[Metric]:
        """Families that have series, in the order of the catalogue."""
        for name, samples in self._meter.samples().items():
            if samples:
                yield _filled(CATALOGUE[name], samples, self._constant)


def _filled(family: Family, samples: Sequence[Sample], constant: Mapping[str, str]) -> Metric:
    names, given = (*family.labels, *constant), tuple(constant.values())
    match family.type:
        case "counter":
            counter = CounterMetricFamily(family.name, family.help, labels=names, unit=family.unit)
            for labels, value in samples:
                counter.add_metric((*labels, *given), value)
            return counter
        case "gauge":
            gauge = GaugeMetricFamily(family.name, family.help, labels=names, unit=family.unit)
            for labels, value in samples:
                gauge.add_metric((*labels, *given), value)
            return gauge
        case "info":
            info = InfoMetricFamily(family.name, family.help, labels=tuple(constant))
            for labels, _ in samples:
                info.add_metric(given, dict(zip(family.labels, labels, strict=True)))
            return info


def exposed(collector: CellCollector, accept: str) -> tuple[bytes, str]:
    """Text and its content type; ``accept`` is the reader's header: OpenMetrics, or Prometheus' own text."""
    encode, content_type = choose_encoder(accept)
    return encode(collector), content_type
