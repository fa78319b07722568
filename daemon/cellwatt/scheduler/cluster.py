"""The connection to a dask scheduler, which for ``local`` is a part of this process and ends with it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any, Final

import dask.config

from cellwatt.errors import CellwattError, ConfigError
from cellwatt.progress import Stage
from cellwatt.scheduler.local import local_cluster
from cellwatt.scheduler.loop import event_loop
from cellwatt.scheduler.place import Place
from cellwatt.scheduler.quiet import distributed
from cellwatt.scheduler.versions import check_versions
from cellwatt.scheduler.work import Work

CONNECT: Final = 5.0
"""s in which a scheduler must answer."""


class Cluster:
    """Workers that do parts of the work. Use as a context manager.

    Entering raises ``CellwattError`` where no scheduler answers; one of our own is started by the first ``run``.
    """

    def __init__(self, place: Place) -> None:
        self._place = place
        self._stack = ExitStack()
        self._client: Any = None

    def __enter__(self) -> Cluster:
        if self._place.address is not None:
            self._connect()
        return self

    def __exit__(self, *_: object) -> None:
        self._client = None
        self._stack.close()

    def run(self, function: Callable[..., Any], items: Sequence[Any], shared: Any, told: Stage) -> list[Any]:
        """Results of the function in the order of the items. Raises as ``spread``, and ``CellwattError``."""
        if self._client is None:
            what, told.name = told.name, "starting the workers"
            self._connect()
            told.name = what
        return Work(self._client, self._place, function, items, shared, told).results()

    def _connect(self) -> None:
        with ExitStack() as opened:
            opened.enter_context(dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 PB"}))
            loop = opened.enter_context(event_loop())
            address = self._place.address
            client = _client(address or opened.enter_context(local_cluster(self._place.workers, loop)), loop)
            opened.callback(_close, client)
            check_versions(client, self._place)
            self._client, self._stack = client, opened.pop_all()


def _client(address: Any, loop: Any) -> Any:
    """Connect to the scheduler at an address, or to a cluster."""
    own = not isinstance(address, str)
    if not own and address.startswith("tls:") and distributed.Security().tls_ca_file is None:
        raise ConfigError(
            f"{address} needs certificates: set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # other versions, which check_versions tells of
            return distributed.Client(address, timeout=CONNECT, set_as_default=False, loop=loop)
    except Exception as error:  # of asyncio, ssl, tornado or distributed
        if own:
            raise CellwattError(f"the local workers do not start: {error}") from error
        port = address.rpartition(":")[2]
        raise CellwattError(
            f"the scheduler at {address} does not answer; start it with: dask scheduler --port {port}"
        ) from error


def _close(client: Any) -> None:
    with suppress(Exception):  # the scheduler may be gone; nothing is left to be done
        client.close(timeout=CONNECT)
