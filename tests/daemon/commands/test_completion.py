"""Completion in bash, by bash itself and by what it calls."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping

import pytest

COMPLETE = "import sys; sys.argv[0] = 'cellwatt'; from cellwatt.commands import main; main()"
BASH = """
eval "$(_CELLWATT_COMPLETE=bash_source cellwatt)"
COMP_WORDS=({words}) COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 ))
COMP_WORDS[$COMP_CWORD]="${{COMP_WORDS[$COMP_CWORD]%_}}"
compopt() {{ echo "option $*"; }}
_cellwatt_completion cellwatt
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def called(command: list[str], environment: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)


@pytest.fixture
def offered(tmp_path):
    """Calls bash with words of which the last is under way; ``_`` stands for its end."""
    if shutil.which("bash") is None:
        pytest.skip("there is no bash")
    script = tmp_path / "cellwatt"
    script.write_text(f"#!{sys.executable}\n{COMPLETE}\n")
    script.chmod(0o755)
    where = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}

    def ask(words: str) -> list[str]:
        done = called(["bash", "-c", BASH.format(words=words)], where)
        assert not done.stderr
        return done.stdout.split("\n")[:-1]

    return ask


@pytest.mark.slow
def test_bash_offers_commands_names_and_files(offered):
    commands = offered("cellwatt e_")
    assert {"emulate", "export", "explain"} <= set(commands) and all(name[0] == "e" for name in commands)
    assert offered("cellwatt drivers scpi_") == offered("cellwatt emulate scpi_") == ["scpi_analyzer"]
    assert "mh12" in offered("cellwatt reference --robot m_")
    assert "default" in offered("cellwatt check cel_")


def test_names_of_commands_are_offered_without_loading_any():
    code = "import atexit; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); " + COMPLETE
    asked = {"_CELLWATT_COMPLETE": "bash_complete", "COMP_WORDS": "cellwatt ", "COMP_CWORD": "1"}
    done = called([sys.executable, "-c", "import sys; " + code], {**os.environ, **asked})
    assert "plain,check" in done.stdout
    loaded = {name.partition(".")[0] for name in done.stderr.split()}
    assert not loaded & {"pyarrow", "scipy", "zenoh", "mcap", "rich", "cellwatt_plugins", "cellwatt_drivers"}
