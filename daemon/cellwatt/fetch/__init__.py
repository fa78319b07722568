"""Files and folders at a URL, as a copy on this disk that is made once for each version of them."""

from cellwatt.fetch.cache import Origin, again, fetch, origin
from cellwatt.fetch.remote import MissingError, is_url

__all__ = ["MissingError", "Origin", "again", "fetch", "is_url", "origin"]
