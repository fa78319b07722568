"""The unit file as systemd itself reads it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from cellwatt.commands import EXIT_USAGE, cli

UNIT = Path(__file__).resolve().parents[2] / "systemd" / "cellwatt@.service"
INSTALLED = "/opt/cellwatt/bin/cellwatt"
EXPOSURE = 19
"""Highest exposure by ``systemd-analyze security``, of 100; it calls up to 40 OK."""

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed (Debian's package systemd)"
)


def values(key: str) -> list[str]:
    """All values of a key, in order."""
    return [line.partition("=")[2] for line in UNIT.read_text().splitlines() if line.startswith(f"{key}=")]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The unit with a program in ExecStart that exists on this machine, which verify wants to see."""
    text = UNIT.read_text()
    assert text.count(f"ExecStart={INSTALLED} ") == 1
    copied = tmp_path / UNIT.name
    copied.write_text(text.replace(f"ExecStart={INSTALLED} ", f"ExecStart={sys.executable} "))
    return copied


def analyze(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", "--no-pager", *arguments], capture_output=True, text=True, check=False)


@needs_systemd
@pytest.mark.parametrize("instance", ["", "weld-3"])
def test_systemd_finds_nothing_wrong(copy: Path, instance: str) -> None:
    path = copy.with_name(f"cellwatt@{instance}.service")
    if instance:
        path.write_text(copy.read_text())
    done = analyze("verify", str(path))
    assert done.returncode == 0, done.stderr
    assert "cellwatt@" not in done.stderr, done.stderr


@needs_systemd
def test_verify_would_tell_a_mistake(copy: Path) -> None:
    copy.write_text(copy.read_text().replace("WatchdogSec=20", "WatchdogSec=often"))
    done = analyze("verify", str(copy))
    assert "cellwatt@.service" in done.stderr
    assert "often" in done.stderr


@needs_systemd
def test_service_is_hardened(copy: Path) -> None:
    done = analyze("security", "--offline=true", f"--threshold={EXPOSURE}", str(copy))
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd-analyze cannot judge a unit file offline (older than systemd 250)")
    assert done.returncode == 0, done.stdout + done.stderr


def test_command_line_is_one_that_cellwatt_has() -> None:
    program, *arguments = values("ExecStart")[0].split()
    assert program == INSTALLED
    assert arguments == ["run", "/etc/cellwatt/%i.yaml"]
    # an unknown option or argument would be a usage error of click's; a missing file is one of ours
    done = CliRunner().invoke(cli, arguments, standalone_mode=False)
    assert "/etc/cellwatt/%i.yaml" in str(done.exception)


def test_wrong_settings_file_is_not_tried_again_for_ever() -> None:
    assert values("RestartPreventExitStatus") == [str(EXIT_USAGE)]
    assert values("Restart") == ["always"]


@pytest.mark.parametrize("family", ["AF_UNIX", "AF_INET", "AF_INET6", "AF_NETLINK"])
def test_network_stays_open(family: str) -> None:
    """Devices by TCP and UDP, routers by both versions of IP, systemd by AF_UNIX, interfaces by netlink."""
    assert family in values("RestrictAddressFamilies")[0].split()
    assert not values("PrivateNetwork")


@pytest.mark.parametrize("kind", ["ttyUSB", "ttyACM", "ttyS", "ttyAMA"])
def test_serial_ports_stay_open(kind: str) -> None:
    assert f"char-{kind} rw" in values("DeviceAllow")
    assert values("SupplementaryGroups") == ["dialout"]
    assert not values("PrivateDevices"), "it would hide all of them"
