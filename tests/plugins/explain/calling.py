"""``explain`` as the command line calls it, and as its tests do."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout

import pytest
from threadpoolctl import threadpool_limits

from cellwatt.commands import main
from cellwatt_plugins.explain.explain import Explained, explain
from cellwatt_plugins.explain.input.admission import admit
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot import Arm


def explained(arm: Arm, runs: Sequence[Run]) -> Explained:
    """What ``explain`` finds in recordings of an arm."""
    with threadpool_limits(1):
        return explain(runs, admit(runs, arm))


def call(*words: object) -> tuple[int, str, str]:
    """Exit code, output and errors of ``cellwatt WORDS…``."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["cellwatt", *map(str, words)])
        with pytest.raises(SystemExit) as stopped:
            main()
    return int(stopped.value.code or 0), out.getvalue(), err.getvalue()
