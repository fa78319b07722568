"""Completion by click."""

from __future__ import annotations

import os
import subprocess
import sys

COMPLETE = "import sys; sys.argv[0] = 'cellwatt'; from cellwatt.commands import main; main()"


def test_names_of_commands_are_offered_without_loading_any():
    code = "import atexit; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); " + COMPLETE
    asked = {"_CELLWATT_COMPLETE": "bash_complete", "COMP_WORDS": "cellwatt ", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", "import sys; " + code],
        env={**os.environ, **asked},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "plain,check" in done.stdout
    loaded = {name.partition(".")[0] for name in done.stderr.split()}
    assert not loaded & {"pyarrow", "scipy", "zenoh", "mcap", "rich", "cellwatt_plugins", "cellwatt_drivers"}
