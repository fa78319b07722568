"""Which effects are there: stepwise selection of terms by their evidence."""

from cellwatt_plugins.mismatch.fit.search.stepwise import search

__all__ = ["search"]
