"""Network namespaces of two plants and headquarters.

    hq ── 10.77.1.0/24 ── plant1 ── 10.88.0.0/24 ── gate1 (NAT) ── 192.168.0.0/24 ── cell1
     └─── 10.77.2.0/24 ── plant2 ── 10.88.0.0/24 ── gate2 (NAT) ── 192.168.0.0/24 ── cell2

Both cells have the same private address, and nobody outside has a route to it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

PLANTS = (1, 2)
PORT = 7447
"""Where all routers listen."""


def missing() -> str | None:
    """Why there can be no such network here; ``None`` if there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if gone := [name for name in ("ip", "nft") if _found(name) is None]:
        return f"{', '.join(gone)} is not installed (apt install iproute2 nftables)"
    probe = f"cwprobe{os.getpid()}"
    try:
        _run("ip", "netns", "add", probe)
        try:
            _run("ip", "netns", "exec", probe, _tool("nft"), "add table ip probe")
        finally:
            _run("ip", "netns", "del", probe)
    except subprocess.CalledProcessError as error:
        return f"no network namespaces or no NAT here: {error.stderr.strip()}"
    return None


def hq_address(plant: int) -> str:
    """Where a plant reaches headquarters."""
    return f"10.77.{plant}.1"


class Network:
    """The namespaces, named after this process, so that several may exist on one machine."""

    def __init__(self) -> None:
        self._tag = f"cw{os.getpid()}"

    def name(self, place: str) -> str:
        """Full name of the namespace of ``hq``, ``plant1``, ``gate1``, ``cell1`` …"""
        return f"{self._tag}{place}"

    def inside(self, place: str) -> list[str]:
        """Begin of a command that runs in a namespace."""
        return [_tool("ip"), "netns", "exec", self.name(place)]

    def cut(self, plant: int) -> None:
        """Take the line from a plant to headquarters away; nobody is told."""
        self._ip(f"plant{plant}", "link", "set", "hq", "down")

    def restore(self, plant: int) -> None:
        """Give the line back."""
        self._ip(f"plant{plant}", "link", "set", "hq", "up")

    def swallow(self, plant: int) -> None:
        """The gate before a cell drops every packet in silence, as a firewall or a radio link does."""
        self._nft(
            plant, "add table ip cut; add chain ip cut none { type filter hook forward priority 0; policy drop; }"
        )

    def pass_again(self, plant: int) -> None:
        """The gate lets packets through again."""
        self._nft(plant, "delete table ip cut")

    def narrow(self, plant: int, rate: float) -> None:
        """The line from a plant to headquarters carries ``rate`` bytes a second."""
        shape = ("tbf", "rate", f"{8 * rate:.0f}bit", "burst", "32kb", "latency", "400ms")
        _run(_tool("tc"), "-n", self.name(f"plant{plant}"), "qdisc", "replace", "dev", "hq", "root", *shape)

    def make(self) -> None:
        """Make all namespaces and lines."""
        for place in ("hq", *(f"{kind}{n}" for n in PLANTS for kind in ("plant", "gate", "cell"))):
            _run(_tool("ip"), "netns", "add", self.name(place))
            self._ip(place, "link", "set", "lo", "up")
        for n in PLANTS:
            self._line(f"plant{n}", "hq", f"10.77.{n}.2", "hq", f"plant{n}", hq_address(n))
            self._line(f"gate{n}", "plant", "10.88.0.2", f"plant{n}", "lan", "10.88.0.1")
            self._line(f"cell{n}", "lan", "192.168.0.2", f"gate{n}", "cells", "192.168.0.1")
            self._ip(f"cell{n}", "route", "add", "default", "via", "192.168.0.1")
            _run(*self.inside(f"gate{n}"), "sh", "-c", "echo 1 >/proc/sys/net/ipv4/ip_forward")
            self._nft(
                n,
                "add table ip nat; add chain ip nat out { type nat hook postrouting priority 100; };"
                " add rule ip nat out oifname plant masquerade",
            )

    def remove(self) -> None:
        """Remove all namespaces; the lines between them go with them."""
        shown = _run(_tool("ip"), "netns", "list").stdout.split()
        for name in shown:
            if name.startswith(self._tag):
                _run(_tool("ip"), "netns", "del", name)

    def _line(self, near: str, device: str, address: str, far: str, far_device: str, far_address: str) -> None:
        self._ip(near, "link", "add", device, "type", "veth", "peer", "name", far_device, "netns", self.name(far))
        for place, name, ip in ((near, device, address), (far, far_device, far_address)):
            self._ip(place, "address", "add", f"{ip}/24", "dev", name)
            self._ip(place, "link", "set", name, "up")

    def _ip(self, place: str, *arguments: str) -> None:
        _run(_tool("ip"), "-n", self.name(place), *arguments)

    def _nft(self, plant: int, rules: str) -> None:
        _run(*self.inside(f"gate{plant}"), _tool("nft"), rules)


@contextmanager
def network() -> Iterator[Network]:
    """The network while the context lasts."""
    made = Network()
    try:
        made.make()
        yield made
    finally:
        made.remove()


def _found(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def _tool(name: str) -> str:
    return _found(name) or name


def _run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
