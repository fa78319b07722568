"""Shows a cell in a browser, from a process of its own."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, ClassVar

from cellwatt.frames import Frames, Layout
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.outlet import ApartOutlet
from cellwatt.outlets.page.settings import PageSettings
from cellwatt.results import Prediction

if find_spec("aiohttp") is None:  # only the process that serves imports it, but what is missing is told at once
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")


class PageOutlet(ApartOutlet[PageSettings]):
    """Shows a cell in a browser: frames, results, events and health; what comes back are orders of people.

    A process of its own serves, so that no browser holds up what the daemon does.
    """

    Settings: ClassVar[type[PageSettings]] = PageSettings
    title = "The cell in a browser: live, its past, its alarms to acknowledge"
    module = "cellwatt.outlets.page.serving"
    what = "the process that serves the page"
    memory = 2 << 30
    forgets = Prediction

    def hello(self) -> Mapping[str, Any]:
        """See ``ApartOutlet.hello``."""
        view = self.view
        return {
            "settings": self.settings.told(),
            "site": view.site,
            "cell": view.cell,
            "session": view.session,
            "record": None if view.record_folder is None else str(view.record_folder),
        }

    def columns(self, layout: Layout) -> bytes:
        """See ``ApartOutlet.columns``."""
        return wire.layout(layout)

    def rows(self, block: Frames) -> bytes:
        """See ``ApartOutlet.rows``."""
        return wire.frames(block)
