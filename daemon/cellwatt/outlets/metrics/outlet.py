"""Tells Prometheus of a cell, and answers probes of its health."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from typing import Any, ClassVar

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from cellwatt.frames import Frames
from cellwatt.outlet import CellView, Item, Outlet
from cellwatt.outlets.apart.outlet import Apart
from cellwatt.outlets.metrics.catalogue import CATALOGUE, Family
from cellwatt.outlets.metrics.meter import Meter, Sample
from cellwatt.outlets.metrics.settings import MetricsSettings
from cellwatt.results import Energy

if find_spec("aiohttp") is None:  # only the process that serves imports it, but what is missing is told at once
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")


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


class MetricsOutlet(Apart[MetricsSettings]):
    """Keeps the newest of what the cell tells and gives it to who asks; nothing is queued, so nothing is lost.

    A process of its own serves. It asks for the text when a reader comes, so that nobody costs anything otherwise.
    """

    Settings: ClassVar[type[MetricsSettings]] = MetricsSettings
    title = "Prometheus: health, losses, alarms, power and energy as metrics, and probes"
    module = "cellwatt.outlets.metrics.serving"
    what = "the process that serves the metrics"
    memory = 256 << 20

    def __init__(self, name: str, settings: MetricsSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._meter = Meter(settings.channels, settings.series, view.session)
        self._collector = CellCollector(self._meter, settings.labels)

    def hello(self) -> Mapping[str, Any]:
        """See ``Apart.hello``."""
        return self.settings.told()

    def offer(self, item: Item) -> None:
        """Keep the newest frame, and sum energies."""
        if isinstance(item, Frames):
            self._meter.frames(item)
        elif isinstance(item, Energy):
            self._meter.energy(item)

    def health(self, status: Mapping[str, Any]) -> None:
        """Keep the cell's health."""
        self._meter.health(status)

    def succeed(self, before: Outlet[Any]) -> None:
        """Go on with the totals of the outlet before this one, so that no counter falls."""
        if isinstance(before, MetricsOutlet):
            self._meter.succeed(before._meter)

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """The text for ``scrapes`` readers with its content type, or the state of the cell for a probe."""
        if "scrapes" in question:
            self._meter.scrapes += question["scrapes"]
            text, kind = exposed(self._collector, question["accept"])
            return {"text": text.decode(), "type": kind}
        status = self._meter.status
        age = self._meter.age(time.monotonic())
        return {"age": age, "state": status.get("state"), "reasons": list(status.get("reasons", ()))}
