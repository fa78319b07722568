"""The scheduler that work is given to, for as long as a command or a program says so."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

from cellwatt.errors import ConfigError
from cellwatt.scheduler.place import parse_place

if TYPE_CHECKING:
    from cellwatt.scheduler.cluster import Cluster

_CLUSTER: ContextVar[Cluster | None] = ContextVar("cluster", default=None)


def cluster() -> Cluster | None:
    """The cluster of the innermost ``scheduled``; None outside, and for a part of work that is on a worker."""
    return _CLUSTER.get()


@contextmanager
def scheduled(place: str | None) -> Iterator[None]:
    """Let ``spread`` give its items to the workers of a dask scheduler inside.

    ``place`` is ``tcp://host:8786`` or ``tls://host:8786``, or ``local`` for a worker a core of this machine
    (``local:2``: two), which end with the context; None changes nothing. Raises ``ConfigError`` where it names no
    scheduler or dask is missing, ``CellwattError`` where nobody answers.
    """
    if place is None:
        yield
        return
    try:
        found = parse_place(place)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    try:
        from cellwatt.scheduler.cluster import Cluster
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("cellwatt"):
            raise
        raise ConfigError(f"a scheduler needs the package {error.name}: pip install 'cellwatt[scale]'") from error
    with Cluster(found) as opened:
        token = _CLUSTER.set(opened)
        try:
            yield
        finally:
            _CLUSTER.reset(token)
