"""ABB robots over Externally Guided Motion and Robot Web Services."""

from cellwatt_drivers.abb.driver import AbbDriver, AbbSettings

__all__ = ["AbbDriver", "AbbSettings"]
