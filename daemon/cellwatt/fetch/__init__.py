"""Files and folders at a URL, as a copy on this disk that is made once for each version of them."""

from cellwatt.fetch.cache import fetch
from cellwatt.fetch.remote import MissingError, is_url

__all__ = ["MissingError", "fetch", "is_url"]
