"""Try the container image: ``python -m release.try_container ROOT`` as root, with buildah and podman.

ROOT comes from ``debootstrap --variant=minbase --include=python3,python3-venv,passwd SUITE ROOT``, where Python has the
minor version of this one, and stands for the base image. The packages are fetched here, so the build needs no index.
The image runs an emulated arm and a cell that reads it; nothing of the trial is left.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from release.build import ROOT, sdist, version, wheel

PATIENCE = 120.0  # s
PORT = 41_004
CELL = f"""\
site: plant
cell: weld
sources:
  arm: {{driver: ur, host: 127.0.0.1, port: {PORT}}}
record: {{}}
zenoh: {{listen: [tcp/127.0.0.1:{PORT + 1}]}}
"""


class Store:
    """Images and containers of their own, in a folder."""

    def __init__(self, folder: Path) -> None:
        self._where = ["--root", str(folder / "images"), "--runroot", str(folder / "run")]

    def __call__(self, tool: str, *arguments: str | Path, fails: bool = False) -> subprocess.CompletedProcess[str]:
        """Run ``podman`` or ``buildah``; show what it does and the end of what it says."""
        print("#", tool, *arguments, flush=True)
        command = [tool, *self._where, *map(str, arguments)]
        done = subprocess.run(command, stdout=-1, stderr=-2, text=True, check=False)
        print(*(f"  {line}" for line in done.stdout.splitlines()[-4:]), sep="\n", flush=True)
        assert fails or done.returncode == 0, done.stdout
        return done


def context(folder: Path) -> Path:
    """What the image is built from: the wheel, the pins, and every package that they name."""
    dist = folder / "dist"
    dist.mkdir()
    shutil.copy(ROOT / "constraints.txt", dist)
    wheel(sdist(folder), dist)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--require-hashes", "--dest", dist]
    subprocess.run([*pip, "-r", ROOT / "constraints.txt"], check=True)
    return dist


def image(store: Store, root: Path, dist: Path) -> None:
    """Build the image ``cellwatt`` on a base made of ``root``."""
    store("buildah", "from", "--name", "base", "scratch")
    store("buildah", "add", "base", root, "/")
    store("buildah", "commit", "base", "localhost/base")
    arguments = [f"--build-arg={name}" for name in ("BASE=localhost/base", "PIP_NO_INDEX=1")]
    file = ROOT / "release/container/Dockerfile"
    store("buildah", "build", "--isolation=chroot", "--format=docker", *arguments, "-f", file, "-t", "cellwatt", dist)


def run(store: Store, folder: Path) -> None:
    """Run an emulated arm and its cell; the health check follows the arm, and SIGTERM ends all in order."""
    settings = folder / "cell.yaml"
    settings.write_text(CELL)
    settings.chmod(0o644)
    started = ("run", "--detach", "--cgroups=disabled", "--network=host")
    cell = ("--name=cell", f"--volume={settings}:/etc/cellwatt/cell.yaml:ro", "--volume=record:/var/lib/cellwatt")
    assert store("podman", "run", "--rm", "--cgroups=disabled", "cellwatt", "--version").stdout.split()[-1] == version()
    store("podman", *started, "--name=arm", "cellwatt", "emulate", "ur", "--listen", f"127.0.0.1:{PORT}")
    store("podman", *started, *cell, "cellwatt")
    assert store("podman", "exec", "cell", "id", "-u").stdout.strip() == "10001"
    await_health(store, 0)
    store("podman", "stop", "arm")
    await_health(store, 1)
    store("podman", "stop", "--time=20", "cell")
    (state,) = json.loads(store("podman", "inspect", "cell").stdout)
    assert state["State"]["ExitCode"] == 0, store("podman", "logs", "cell").stdout
    files = store(
        "podman", "run", "--rm", "--cgroups=disabled", "--volume=record:/r", "--entrypoint=find", "cellwatt", "/r"
    )
    assert ".mcap\n" in files.stdout and ".part" not in files.stdout, files.stdout


def await_health(store: Store, code: int) -> None:
    """Return once the image's health check ends with this exit code."""
    end = time.monotonic() + PATIENCE
    while (done := store("podman", "healthcheck", "run", "cell", fails=True)).returncode != code:
        assert time.monotonic() < end, (done.stdout, store("podman", "logs", "cell").stdout)
        time.sleep(1.0)


def main(root: Path) -> None:
    """Build and run; ends with an error at the first step that fails."""
    with tempfile.TemporaryDirectory(dir="/var/tmp") as name:
        folder = Path(name)
        store = Store(folder)
        try:
            image(store, root, context(folder))
            (about,) = json.loads(store("podman", "image", "inspect", "cellwatt").stdout)
            run(store, folder)
        finally:
            store("podman", "rm", "--all", "--force", fails=True)
            store("buildah", "rm", "--all", fails=True)
            store("podman", "rmi", "--all", "--force", fails=True)
    print(f"image: {about['Size'] / 1e6:.0f} MB with its base, run, healthy, told of a dead arm, ended, recorded")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
