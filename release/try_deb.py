"""Try the Debian package in a clean root: ``python -m release.try_deb PACKAGE ROOT`` as root.

ROOT comes from ``debootstrap --variant=minbase --include=python3,passwd,libgomp1 SUITE ROOT`` and is changed. An older
package with the same scripts is installed first, then PACKAGE over it; it runs, is removed and purged, and what belongs
to the user is still there.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

CELL = "site: plant\ncell: weld\nsources:\n  arm: {driver: ur, host: 127.0.0.1}\nstages: {segment: {}}\n"


def main(package: Path, root: Path) -> None:
    """Install, upgrade, run, remove, purge; ends with an error at the first step that fails."""

    def inside(*command: str) -> str:
        print("#", *command, flush=True)
        # A process namespace of its own, so that nothing here can reach the services of this PC.
        chroot = ["unshare", "--mount", "--pid", "--fork", "chroot", root, *command]
        environment = {
            "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
            "LC_ALL": "C.UTF-8",
            "DEBIAN_FRONTEND": "noninteractive",
        }
        done = subprocess.run(chroot, env=environment, stdout=-1, stderr=-2, text=True, check=False)
        print(*(f"  {line}" for line in done.stdout.splitlines()[-4:]), sep="\n", flush=True)
        assert done.returncode == 0, done.stdout
        return done.stdout

    shutil.copy(package, root / "new.deb")
    _older(package, root / "old.deb")
    inside("dpkg", "-i", "/old.deb")
    settings = root / "etc/cellwatt/weld.yaml"
    settings.write_text(CELL)
    inside("cellwatt-add-cell", "weld", "--serial")
    assert settings.stat().st_mode & 0o777 == 0o640
    assert (root / "etc/systemd/system/cellwatt@weld.service.d/serial.conf").exists()
    inside("dpkg", "-i", "/new.deb")
    assert not (root / "opt/cellwatt/OLD").exists()
    assert inside("cellwatt", "--version").split()[-1].replace("rc", "~rc") in package.name
    inside("cellwatt", "drivers")
    inside("runuser", "-u", "cellwatt-weld", "--", "cellwatt", "check", "/etc/cellwatt/weld.yaml")
    unit = (root / "lib/systemd/system/cellwatt@.service").read_text()
    assert "ExecStart=/opt/cellwatt/bin/cellwatt run" in unit
    inside("dpkg", "--remove", "cellwatt")
    assert not (root / "opt/cellwatt").exists(), sorted((root / "opt/cellwatt").rglob("*"))[:5]
    assert not (root / "lib/systemd/system/cellwatt@.service").exists()
    inside("dpkg", "--purge", "cellwatt")
    assert settings.read_text() == CELL
    print(f"{package.name}: {package.stat().st_size / 1e6:.0f} MB, installed, upgraded, run, removed, purged")


def _older(package: Path, to: Path) -> None:
    """Make a package of a lower version with the scripts of this one and little else."""
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder)
        stage.chmod(0o755)
        subprocess.run(["dpkg-deb", "--control", package, stage / "DEBIAN"], check=True)
        control = stage / "DEBIAN/control"
        lines = control.read_text().splitlines()
        control.write_text("\n".join("Version: 0.1.0" if x.startswith("Version:") else x for x in lines) + "\n")
        for path, source in {"opt/cellwatt/OLD": "", "opt/cellwatt/share/serial.conf": "serial.conf"}.items():
            (stage / path).parent.mkdir(parents=True, exist_ok=True)
            (stage / path).write_text((SYSTEMD / source).read_text() if source else "")
        (stage / "etc/cellwatt").mkdir(parents=True)
        (stage / "usr/sbin").mkdir(parents=True)
        shutil.copy(SYSTEMD / "cellwatt-add-cell", stage / "usr/sbin")
        subprocess.run(["dpkg-deb", "--root-owner-group", "--build", stage, to], check=True, stdout=subprocess.DEVNULL)


SYSTEMD = Path(__file__).resolve().parents[1] / "systemd"

if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
