"""The page: a cell, or all cells of a site, in a browser."""

from cellwatt.sinks.page.settings import PageSettings, UserSettings
from cellwatt.sinks.page.sink import PageSink

__all__ = ["PageSettings", "PageSink", "UserSettings"]
