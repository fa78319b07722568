"""What holds for every test: one thread of linear algebra, nothing left behind, no loop held up, its worker."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Generator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

# Before numpy is imported, and for every child: the tests are many processes already.
for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# What one has compiled, all the children and the next run find: a short daemon would compile for half of its time.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

from hypothesis import HealthCheck, settings  # noqa: E402

from tests.blocked_loop import _calls_that_block, _loop_goes_on, _steps_timed  # noqa: E402
from tests.groups import group, turn  # noqa: E402
from tests.left_behind import _nothing_is_left_behind, _of_the_session  # noqa: E402
from tests.patience import FACTOR  # noqa: E402

__all__ = ["_calls_that_block", "_loop_goes_on", "_nothing_is_left_behind", "_of_the_session", "_steps_timed"]


# A draw that waited for a core is not too slow. The same draws in every run: a change is not blamed for a case that it
# did not cause; ``just explore`` draws others.
settings.register_profile("same", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
settings.register_profile("explore", settings.get_profile("same"), derandomize=False)
settings.load_profile("same")


TESTS = Path(__file__).parent


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Collects no garbage, as all that is made is kept. A worker compiles its share before it asks for the others'."""
    gc.disable()
    worker = getattr(session.config, "workerinput", None)
    if worker and [Path(path).resolve() for path in session.config.args] == [TESTS]:
        for path in sorted(TESTS.rglob("test_*.py"))[int(worker["workerid"][2:]) :: worker["workercount"]]:
            with suppress(Exception, pytest.skip.Exception):  # told where its tests are collected
                import_module(".".join(path.relative_to(TESTS.parent).with_suffix("").parts))
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: turn(item.nodeid))
    for item in items if FACTOR != 1.0 else ():
        limit = item.get_closest_marker("timeout")
        seconds = limit.args[0] if limit else float(config.getini("timeout"))
        item.add_marker(pytest.mark.timeout(FACTOR * seconds), append=False)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(call: pytest.CallInfo[None]) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Collects no garbage while a failure is put into words: its finalizers log, which CPython 3.11 fails in."""
    collects = gc.isenabled()
    if call.excinfo:
        gc.disable()
    try:
        return (yield)
    finally:
        if collects:
            gc.enable()


@pytest.hookimpl(optionalhook=True, tryfirst=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """One more than there are cores, as many tests wait. Where the variable is set, xdist asks it."""
    if os.environ.get("PYTEST_XDIST_AUTO_NUM_WORKERS"):
        return None
    return 1 + (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    from xdist.scheduler import LoadScopeScheduling

    class InGroups(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group(nodeid)

    config.option.loadscopereorder = False  # by the number of tests; ours is by time
    return InGroups(config, log)
