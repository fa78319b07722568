"""The Debian package: a venv under /opt/cellwatt with the pinned packages, the units, and a helper for cells.

It is built by Debian's own Python, with which it then runs, and fits the Debian release on which it was built.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHON = "/usr/bin/python3"
HOME = Path("opt/cellwatt")
SCRIPTS = ROOT / "release" / "debian"


def build(wheel: Path, version: str, out: Path) -> Path:
    """Build the package of a wheel. Raises ``CalledProcessError`` where pip or dpkg-deb refuses."""
    number = debian_version(version)
    architecture = _said("dpkg", "--print-architecture")
    package = out / f"cellwatt_{number}_{architecture}.deb"
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder)
        stage.chmod(0o755)
        _install(stage, wheel)
        _place(stage)
        _describe(stage, number, architecture)
        pack = ["dpkg-deb", "--root-owner-group", "-Zzstd", "-z9", "--build", stage, package]
        subprocess.run(pack, check=True, stdout=subprocess.DEVNULL)
    return package


def debian_version(version: str) -> str:
    """A version as Debian orders it: a candidate comes before its release (``1.0.0rc1`` is ``1.0.0~rc1``)."""
    return re.sub(r"(\d)(a|b|rc|\.dev)(\d)", r"\1~\2\3", version).replace("~.dev", "~dev")


def _install(stage: Path, wheel: Path) -> None:
    home = stage / HOME
    # Python's own settings of the builder do not reach it; those of pip (the index) do.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | {"SOURCE_DATE_EPOCH": "0"}
    subprocess.run([PYTHON, "-m", "venv", home], check=True, env=environment)
    pip = [home / "bin" / "python", "-m", "pip", "install", "--quiet", "--no-compile"]
    subprocess.run([*pip, "--require-hashes", "--no-deps", "-r", ROOT / "constraints.txt"], check=True, env=environment)
    subprocess.run([*pip, "--no-deps", "--no-index", wheel], check=True, env=environment)
    leave = [home / "bin" / "python", "-m", "pip", "uninstall", "--quiet", "--yes", "setuptools", "pip"]
    subprocess.run(leave, check=True, env=environment)
    for script in (home / "bin").iterdir():
        if script.name.lower().startswith(("activate", "pip")):
            script.unlink()
        elif not script.is_symlink() and script.read_bytes()[:2] == b"#!":
            script.write_bytes(script.read_bytes().replace(str(home).encode(), b"/opt/cellwatt"))
    settings = home / "pyvenv.cfg"
    settings.write_text(settings.read_text().replace(str(home), "/opt/cellwatt"))
    for cache in list(home.rglob("__pycache__")):
        shutil.rmtree(cache)
    for record in home.rglob("direct_url.json"):
        record.unlink()


def _place(stage: Path) -> None:
    units = stage / "lib/systemd/system"
    _copy(ROOT / "systemd/cellwatt@.service", units / "cellwatt@.service")
    _copy(ROOT / "systemd/serial.conf", stage / HOME / "share/serial.conf")
    _copy(ROOT / "systemd/cellwatt-add-cell", stage / "usr/sbin/cellwatt-add-cell", 0o755)
    _copy(ROOT / "CHANGELOG.md", stage / "usr/share/doc/cellwatt/CHANGELOG.md")
    _copy(ROOT / "LICENSE", stage / "usr/share/doc/cellwatt/copyright")
    for example in sorted((ROOT / "examples").glob("*.yaml")):
        _copy(example, stage / "usr/share/doc/cellwatt/examples" / example.name)
    (stage / "etc/cellwatt").mkdir(parents=True)
    (stage / "usr/bin").mkdir(parents=True)
    (stage / "usr/bin/cellwatt").symlink_to("/opt/cellwatt/bin/cellwatt")


def _describe(stage: Path, number: str, architecture: str) -> None:
    size = sum(f.lstat().st_size for f in stage.rglob("*") if f.is_file()) // 1024
    minor = int(_said(PYTHON, "-c", "import sys; print(sys.version_info.minor)"))
    fields = {"version": number, "architecture": architecture, "size": size, "minor": minor, "next": minor + 1}
    control = stage / "DEBIAN"
    control.mkdir()
    (control / "control").write_text((SCRIPTS / "control").read_text().format(**fields))
    for name in ("postinst", "prerm", "postrm"):
        _copy(SCRIPTS / name, control / name, 0o755)


def _copy(source: Path, target: Path, mode: int = 0o644) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
    target.chmod(mode)


def _said(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
