"""Stepwise selection of effects by their evidence."""

from cellwatt_plugins.explain.fit.search.stepwise import search

__all__ = ["search"]
