"""ABB robots over Externally Guided Motion and Robot Web Services."""

from cellwatt_drivers.abb.driver import AbbDriver
from cellwatt_drivers.abb.settings import AbbSettings

__all__ = ["AbbDriver", "AbbSettings"]
