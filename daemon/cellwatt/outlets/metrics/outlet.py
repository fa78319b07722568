"""Tells Prometheus of a cell, and answers probes of its health."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any, ClassVar

from cellwatt.frames import Frames
from cellwatt.outlet import CellView, Item, Outlet
from cellwatt.outlets.listening import tls_context
from cellwatt.outlets.metrics.meter import Meter
from cellwatt.outlets.metrics.serving import Endpoint
from cellwatt.outlets.metrics.settings import MetricsSettings
from cellwatt.results import Energy


class MetricsOutlet(Outlet[MetricsSettings]):
    """Keeps the newest of what the cell tells and gives it to who asks; nothing is queued, so nothing is lost."""

    Settings: ClassVar[type[MetricsSettings]] = MetricsSettings
    title = "Prometheus: health, losses, alarms, power and energy as metrics, and probes"

    def __init__(self, name: str, settings: MetricsSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._meter = Meter(settings.channels, settings.series, view.session)

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

    async def run(self) -> None:
        """Serve until cancelled. Raises ``OutletError`` if the address cannot be listened at."""
        endpoint = Endpoint(self.settings, self._meter)
        self.url = await endpoint.start(await asyncio.to_thread(tls_context, self.settings))
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self.url = None
            await endpoint.stop()
