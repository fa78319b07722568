"""The workers of a dask scheduler, on any number of machines."""

from __future__ import annotations

import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import dask.config

from cellwatt.errors import CellwattError, ConfigError
from cellwatt.progress import Stage
from cellwatt.scheduler.parcel import call, pack, parcels, result, shortened

# distributed's loggers get their handlers, which write to stderr, when it is imported; what matters are its exceptions.
_NONE: Final = {"handlers": ["none"], "propagate": False}
_LOGGING: Final = {
    "version": 1,
    "disable_existing_loggers": False,
    "handlers": {"none": {"class": "logging.NullHandler"}},
    "loggers": {"distributed": _NONE, "tornado": _NONE},
}
with dask.config.set(logging=_LOGGING):
    import distributed as _distributed

distributed: Any = _distributed  # much of which has no types

CONNECT: Final = 5.0
"""s in which a scheduler must answer."""
WORKERLESS: Final = 60.0
"""s without any worker that end the work."""
LOOK: Final = 1.0
"""s between two looks at who works."""
PACKAGES: Final = ("cellwatt", "numpy", "distributed")
"""Equal results need the same versions of these, and of Python, everywhere."""


class Hosts:
    """Workers of the scheduler at ``address``. Entering raises ``CellwattError`` where it does not answer."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._there: set[str] = set()
        self._seen = time.monotonic()

    def __enter__(self) -> Hosts:
        security = distributed.Security()
        if self._address.startswith("tls:") and security.tls_ca_file is None:
            raise ConfigError(
                f"{self._address} needs certificates: set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
                "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY"
            )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # other versions, which check_versions tells of
                self._client = distributed.Client(self._address, timeout=CONNECT, set_as_default=False)
        except Exception as error:  # of asyncio, ssl, tornado or distributed
            port = self._address.rpartition(":")[2]
            why = ", or refuses these certificates" if self._address.startswith("tls:") else ""
            raise CellwattError(
                f"the scheduler at {self._address} does not answer{why}; start it with: dask scheduler --port {port}"
            ) from error
        try:
            check_versions(self._client, self._address)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(Exception):  # the scheduler may be gone; nothing is left to be done
            self._client.close(timeout=CONNECT)

    def run(self, function: Callable[..., Any], items: Sequence[Any], shared: Any, told: Stage) -> list[Any]:
        """Results in the order of the items. Raises as ``spread``, and ``CellwattError`` for what the workers cannot.

        What a worker had when it went away is done by others. What an item shares with the others is a task of its own,
        so that it is made again where the worker that held it has gone.
        """
        name, what = f"cellwatt-{uuid.uuid4().hex}", told.name
        self._seen = time.monotonic()
        with self._reached(what), dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 PB"}):
            kept = None if shared is None else self._client.submit(bytes, pack(shared), key=f"{name}-shared")
            answers = [
                self._client.submit(call, parcel, str(Path.cwd()), kept, key=f"{name}-{i}")
                for i, parcel in enumerate(parcels(function, items))
            ]
            results = []
            for i, answer in enumerate(answers):
                while not answer.done():
                    told.name = what if self._look() else f"{what}, waiting for a worker"
                    with suppress(TimeoutError), self._client.as_current():
                        distributed.wait([answer], LOOK)
                if answer.status == "error":
                    check_versions(self._client, self._address)  # of workers that have come since
                    item = f"{what}: item {i + 1} of {len(items)} ({shortened(items[i])})"
                    raise CellwattError(_undone(item, self._address, answer.exception()))
                results.append(result(answer.result()))
                told.done = i + 1.0
            return results

    def _look(self) -> bool:
        """Whether there are workers. Raises ``CancelledError`` where the scheduler is gone."""
        there = set(self._client.scheduler_info(n_workers=-1)["workers"])
        if self._client.status != "running":
            raise CancelledError
        if there - self._there:
            check_versions(self._client, self._address)
        self._there, now = there, time.monotonic()
        if there:
            self._seen = now
        elif now - self._seen > WORKERLESS:
            raise CellwattError(
                f"the scheduler at {self._address} has had no worker for {WORKERLESS:.0f} s; "
                f"start one with: dask worker {self._address}"
            )
        return bool(there)

    @contextmanager
    def _reached(self, what: str) -> Iterator[None]:
        """Put into words that the scheduler is gone."""
        try:
            yield
        except (CancelledError, OSError, distributed.client.ClosedClientError) as error:
            gone = f"the scheduler at {self._address} is gone, or has dropped this work"
            raise CellwattError(f"{what}: {gone}: start it again, then this command") from error


def check_versions(client: Any, address: str) -> None:
    """Raise ``CellwattError`` where the scheduler or a worker has another version of what gives the results."""
    told = client.get_versions(packages=PACKAGES)
    here = _versions(told["client"])
    there = [(f"the scheduler at {address}", told["scheduler"])]
    there += [(f"the worker {worker}", theirs) for worker, theirs in sorted(told["workers"].items())]
    for who, theirs in there:
        for name, version in _versions(theirs).items() if theirs else ():  # a worker may leave meanwhile
            if version != here[name]:
                has = f"has {name} {version}" if version else f"has no {name}"
                raise CellwattError(f"{who} is refused: it {has}, here is {name} {here[name]}; install the same there")


def _versions(told: Mapping[str, Any]) -> dict[str, str | None]:
    python = ".".join(str(told["host"]["python"]).split(".")[:2])
    return {"Python": python} | {name: told["packages"].get(name) for name in PACKAGES}


def _undone(item: str, address: str, error: BaseException) -> str:
    if isinstance(error, distributed.scheduler.KilledWorker):
        return f"{item}: each worker that took it died, of it or of one beside it: have they enough memory?"
    return f"{item} cannot be done by the scheduler at {address}: {type(error).__name__}: {error}"
