"""The version of this package, as recordings and reports name it."""

__version__ = "0.1.0"
