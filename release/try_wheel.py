"""Try the wheel as a user would: ``python -m release.try_wheel``.

The sdist is built from the tree, the wheel from the sdist, and the wheel installed into an empty environment with the
pinned packages. Git is not on the path there, nor is the source tree.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from release.build import ROOT, sdist, version, wheel


def clean_environment(folder: Path) -> dict[str, str]:
    """Environment without git, without this tree and with an empty home; pip keeps its settings."""
    tools = folder / "tools"
    tools.mkdir()
    for name in ("sh", "env", "ldconfig", "uname", "gcc"):
        found = next((p for d in os.get_exec_path() if (p := Path(d) / name).exists()), None)
        if found is not None:
            (tools / name).symlink_to(found)
    kept = {k: v for k, v in os.environ.items() if k.startswith(("PIP_", "SSL_", "LC_", "LANG"))}
    return {**kept, "PATH": str(tools), "HOME": str(folder)}


def readme_cell() -> str:
    """The settings file that the README shows."""
    found = re.search(r"^```yaml\n(site: .*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def main() -> None:
    """Build, install and run; ends with an error at the first command that fails."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = wheel(sdist(folder), folder)
        environment = clean_environment(folder)
        subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True, env=environment)
        python = folder / "venv/bin/python"
        pip = [python, "-m", "pip", "install", "--quiet"]
        pins = ["--require-hashes", "--no-deps", "-r", ROOT / "constraints.txt"]
        subprocess.run([*pip, *pins], check=True, env=environment)
        subprocess.run([*pip, "--no-deps", made], check=True, env=environment)
        (folder / "cell.yaml").write_text(readme_cell())
        for arguments in (
            ["--version"],
            ["check", "cell.yaml"],
            ["drivers"],
            ["demo", "--seconds", "20"],
        ):
            print("$ cellwatt", *arguments, flush=True)
            command = [folder / "venv/bin/cellwatt", *arguments]
            done = subprocess.run(command, cwd=folder, env=environment, stdout=-1, text=True, check=False)
            print(*done.stdout.splitlines()[-6:], sep="\n", flush=True)
            assert done.returncode == 0, done.stdout
            assert arguments != ["--version"] or version() in done.stdout, done.stdout
        print(f"{made.name}: {made.stat().st_size / 1e6:.1f} MB, installed and tried")


if __name__ == "__main__":
    main()
