"""The version of this package, as recordings and reports name it."""

from importlib.metadata import version

__version__ = version("cellwatt")
