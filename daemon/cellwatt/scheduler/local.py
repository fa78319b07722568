"""A scheduler of our own, and a process for each core, on the loopback interface and behind certificates of its own."""

from __future__ import annotations

import logging
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Final

import dask.config
import dask.system
from tornado.ioloop import IOLoop

from cellwatt.errors import CellwattError, ConfigError
from cellwatt.scheduler.quiet import distributed

LOOPBACK: Final = "127.0.0.1"
_SETTINGS: Final = {
    "distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED": "critical",
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    "distributed.worker.profile.enabled": False,
}
"""Settings of dask: workers write nothing to the terminal, show nothing to a browser, and keep no profile."""
_TRIES: Final = 1
"""Workers that may die of an item before it is looked at alone."""


@contextmanager
def local_cluster(workers: int | None, loop: IOLoop) -> Iterator[Any]:
    """A cluster of processes with one thread each (None: one a core), that are killed at the end.

    Raises ``CellwattError`` where they do not start.
    """
    environment = dict(os.environ)
    with ExitStack() as stack:
        stack.callback(_restore, environment)
        folder = tempfile.TemporaryDirectory(prefix="cellwatt-workers-", ignore_cleanup_errors=True)
        stack.enter_context(folder)
        stack.enter_context(dask.config.set({**_SETTINGS, "temporary-directory": folder.name}))
        cluster = _started(workers or dask.system.CPU_COUNT, folder.name, loop)
        stack.callback(_end, cluster)
        yield cluster


def _started(workers: int, folder: str, loop: IOLoop) -> Any:
    try:
        # Whoever reaches a scheduler has it run any code: other users of this machine must not.
        security = distributed.Security.temporary()
    except ImportError as error:
        raise ConfigError("local workers need the package cryptography: pip install 'cellwatt[scale]'") from error
    try:
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host=LOOPBACK,
            security=security,
            memory_limit=0,
            local_directory=folder,
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={
                "dashboard": False,
                "dashboard_address": f"{LOOPBACK}:0",
                "allowed_failures": _TRIES,
            },
            loop=loop,
        )
    except Exception as error:  # of asyncio, multiprocessing or distributed
        raise CellwattError(f"the local workers do not start: {' '.join(str(error).split())}") from error


def _end(cluster: Any) -> None:
    """Kill the workers, which may be in the middle of what nobody waits for any more, and close the scheduler."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        if nanny.pid is not None:
            with suppress(ProcessLookupError):
                os.kill(nanny.pid, signal.SIGKILL)
    with suppress(Exception):  # of workers that have gone in the middle of it
        cluster.close()


def _restore(environment: dict[str, str]) -> None:
    """Take away what dask sets for its workers in the environment of this process."""
    for name in set(os.environ) - set(environment):
        del os.environ[name]
    os.environ.update(environment)
