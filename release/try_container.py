"""Try the container image: ``python -m release.try_container ROOT`` as root, with buildah.

ROOT comes from ``debootstrap --variant=minbase --include=python3,python3-venv,passwd SUITE ROOT``, where Python has the
minor version of this one, and stands for the base image. The packages are fetched here, so the build needs no index.
The image runs an emulated arm and a cell that reads it, with its own entry point, user and health check, in a changed
root and with the network of this PC: that needs neither systemd nor cgroups. Nothing of the trial is left.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
        self._command = ["buildah", "--root", str(folder / "images"), "--runroot", str(folder / "run")]

    def __call__(self, *arguments: str | Path, fails: bool = False) -> subprocess.CompletedProcess[str]:
        """Run ``buildah``; show what it does and the end of what it says."""
        print("# buildah", *arguments, flush=True)
        done = subprocess.run([*self._command, *map(str, arguments)], stdout=-1, stderr=-2, text=True, check=False)
        print(*(f"  {line}" for line in done.stdout.splitlines()[-4:]), sep="\n", flush=True)
        assert fails or done.returncode == 0, done.stdout
        return done

    @contextmanager
    def running(self, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
        """Run ``buildah`` beside; SIGTERM ends it, and with it what it runs."""
        print("# buildah", *arguments, "&", flush=True)
        with subprocess.Popen([*self._command, *arguments]) as process:
            try:
                yield process
            finally:
                process.terminate()


def context(folder: Path) -> Path:
    """What the image is built from: the wheel, the pins, and every package that they name."""
    dist = folder / "dist"
    dist.mkdir()
    shutil.copy(ROOT / "constraints.txt", dist)
    wheel(sdist(folder), dist)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--require-hashes", "--dest", dist]
    subprocess.run([*pip, "--no-deps", "-r", ROOT / "constraints.txt"], check=True)
    return dist


def image(store: Store, root: Path, dist: Path) -> dict[str, Any]:
    """Build the image ``cellwatt`` on a base made of ``root``; return its configuration."""
    store("from", "--name", "base", "scratch")
    store("add", "base", root, "/")
    store("commit", "base", "localhost/base")
    arguments = [f"--build-arg={name}" for name in ("BASE=localhost/base", "PIP_NO_INDEX=1")]
    file = ROOT / "release/container/Dockerfile"
    store("build", "--isolation=chroot", "--format=docker", *arguments, "-f", file, "-t", "cellwatt", dist)
    about: dict[str, Any] = json.loads(store("inspect", "--type=image", "cellwatt").stdout)["Docker"]["config"]
    return about


def run(store: Store, about: dict[str, Any], folder: Path) -> None:
    """Run an emulated arm and its cell; the health check follows the arm, and SIGTERM ends the cell in order."""
    record, settings = folder / "record", folder / "cell.yaml"
    settings.write_text(CELL)
    settings.chmod(0o644)
    record.mkdir()
    shutil.chown(record, 10001, 10001)
    folder.chmod(0o755)
    store("from", "--name", "cell", "cellwatt")
    volumes = (f"--volume={settings}:/etc/cellwatt/cell.yaml:ro", f"--volume={record}:/var/lib/cellwatt")
    inside = ("run", "--isolation=chroot", *volumes, "cell", "--")
    assert store(*inside, "id", "-u").stdout.strip() == "10001"
    assert store(*inside, *about["Entrypoint"], "--version").stdout.split()[-1] == version()
    check = about["Healthcheck"]["Test"]
    assert check[0] == "CMD"
    with store.running(*inside, *about["Entrypoint"], *about["Cmd"]) as cell:
        with store.running(*inside, *about["Entrypoint"], "emulate", "ur", "--listen", f"127.0.0.1:{PORT}"):
            _await_health(store, (*inside, *check[1:]), 0, "1 of 1 sources")
        _await_health(store, (*inside, *check[1:]), 1, "0 of 1 sources")
        # Not through buildah, which kills what it runs: the daemon is the oldest Python of the image's user.
        daemon = f"^[^ ]*python[^ ]* .*{' '.join(about['Cmd'])}"
        subprocess.run(["pkill", "-TERM", "--oldest", "--uid", "10001", "-f", daemon], check=True)
        assert cell.wait(30) == 0
    names = [file.name for file in record.rglob("*")]
    assert any(name.endswith(".mcap") for name in names), names
    assert not any(name.endswith(".part") for name in names), names


def _await_health(store: Store, check: tuple[str, ...], code: int, said: str) -> None:
    """Return once the image's health check ends with this exit code and says this."""
    end = time.monotonic() + PATIENCE
    while (done := store(*check, fails=True)).returncode != code or said not in done.stdout:
        assert time.monotonic() < end, done.stdout
        time.sleep(1.0)


def main(root: Path) -> None:
    """Build and run; ends with an error at the first step that fails."""
    with tempfile.TemporaryDirectory(dir="/var/tmp") as name:
        folder = Path(name)
        store = Store(folder)
        try:
            about = image(store, root, context(folder))
            (listed,) = json.loads(store("images", "--json", "cellwatt").stdout)
            run(store, about, folder)
        finally:
            store("rm", "--all", fails=True)
            store("rmi", "--all", "--force", fails=True)
    print(f"image: {listed['size']} with its base, run, healthy, told of a dead arm, ended, recorded")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
