"""The page: shows a cell, or all cells of a site, in a browser."""

from cellwatt.outlets.page.outlet import PageOutlet, PageSettings, UserSettings

__all__ = ["PageOutlet", "PageSettings", "UserSettings"]
