"""The unit file as systemd itself reads it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from pathlib import Path

import pytest
from click.testing import CliRunner

from cellwatt.commands import cli

UNIT = Path(__file__).resolve().parents[2] / "systemd" / "cellwatt@.service"
INSTALLED = "/opt/cellwatt/bin/cellwatt"
SERIAL = UNIT.with_name("serial.conf")
EXPOSURE = {"alone": 12, "with serial ports": 14}
"""Highest exposure by ``systemd-analyze security``, of 100; it calls up to 40 OK."""

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed (Debian's package systemd)"
)


def values(key: str, path: Path = UNIT) -> list[str]:
    """All values of a key, in order."""
    return [line.partition("=")[2] for line in path.read_text().splitlines() if line.startswith(f"{key}=")]


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
@pytest.mark.parametrize("ports", EXPOSURE)
def test_service_is_hardened(copy: Path, ports: str) -> None:
    if ports == "with serial ports":
        beside = copy.with_name(f"{copy.name}.d")
        beside.mkdir()
        (beside / SERIAL.name).write_text(SERIAL.read_text())
    done = analyze("security", "--offline=true", f"--threshold={EXPOSURE[ports]}", str(copy))
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


@pytest.mark.parametrize("kind", ["ttyUSB", "ttyS"])
def test_serial_ports_are_opened_by_their_drop_in_alone(kind: str) -> None:
    assert values("PrivateDevices") == ["yes"]
    assert not values("DeviceAllow")
    assert f"char-{kind} rw" in values("DeviceAllow", SERIAL)
    assert values("SupplementaryGroups", SERIAL) == ["dialout"]
    assert values("PrivateDevices", SERIAL) == ["no"], "it would hide all of them"


@pytest.mark.parametrize("address", ["127.0.0.1", "172.31.255.254", "fd00::1"])
def test_the_plants_network_stays_open(address: str) -> None:
    assert any(ip_address(address) in network for network in allowed())


@pytest.mark.parametrize("address", ["172.32.0.1", "2001:4860:4860::8888"])
def test_the_rest_of_the_world_is_closed(address: str) -> None:
    assert values("IPAddressDeny") == ["any"]
    assert not any(ip_address(address) in network for network in allowed())


NAMED = {
    "localhost": ["127.0.0.0/8", "::1/128"],
    "link-local": ["169.254.0.0/16", "fe80::/64"],
    "multicast": ["224.0.0.0/4", "ff00::/8"],
}
"""What systemd.resource-control(5) says that these names stand for."""


def allowed() -> list[IPv4Network | IPv6Network]:
    words = " ".join(values("IPAddressAllow")).split()
    return [ip_network(part) for word in words for part in NAMED.get(word, [word])]


def test_the_daemon_needs_nothing_but_its_own_proc(tmp_path: Path) -> None:
    """``ProcSubset=pid``, tried on what reads /proc: the time that a process was kept from running."""
    mounted = tmp_path / "proc"
    mounted.mkdir()
    script = (
        f"mount -t proc -o subset=pid proc {mounted} && mount --move {mounted} /proc && test ! -e /proc/stat && "
        f"exec {sys.executable} -c "
        "'from cellwatt import processor; "
        "print(processor.RunDelay().look() >= 0, [name for name in processor._open if processor._open[name] >= 0])'"
    )
    done = subprocess.run(["unshare", "--mount", "sh", "-c", script], capture_output=True, text=True, check=False)
    if done.returncode and not done.stderr.startswith("Traceback"):
        pytest.skip(f"this machine gives no mounts: {done.stderr.strip()}")
    assert re.fullmatch(r"True \['/proc/\d+/schedstat'\]\n", done.stdout), done.stderr
