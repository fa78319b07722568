"""Servers of this host: Mosquitto and InfluxDB."""

from __future__ import annotations

import getpass
import shutil
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from outlet.children import free_port

MOSQUITTO: Final = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
INFLUXD: Final = shutil.which("influxd")
START: Final = 30.0
"""s for the start of a server."""
DATABASE: Final = "bench"


class Mosquitto:
    """A broker on a port of its own, in ``folder``."""

    def __init__(self, folder: Path) -> None:
        if MOSQUITTO is None:
            raise RuntimeError("mosquitto is not installed")
        self.port = free_port()
        file = folder / f"mosquitto-{self.port}.conf"
        lines = ("allow_anonymous true", "persistence false", "max_queued_messages 0", "set_tcp_nodelay true")
        file.write_text("\n".join((f"listener {self.port} 127.0.0.1", f"user {getpass.getuser()}", *lines)) + "\n")
        self.process = subprocess.Popen([MOSQUITTO, "-c", str(file)], stderr=subprocess.DEVNULL)
        end = time.monotonic() + START
        while time.monotonic() < end and self.process.poll() is None:
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), timeout=1):
                return
            time.sleep(0.02)
        self.end()
        raise RuntimeError("mosquitto does not begin")

    def end(self) -> None:
        """Kill it."""
        self.process.kill()
        self.process.wait()


@contextmanager
def mosquitto(folder: Path) -> Iterator[Mosquitto]:
    """A broker for as long as the context lasts."""
    broker = Mosquitto(folder)
    try:
        yield broker
    finally:
        broker.end()


@contextmanager
def influxd(folder: Path) -> Iterator[str]:
    """InfluxDB 1 with an empty database ``bench`` in a folder that is made; gives its address."""
    if INFLUXD is None:
        raise RuntimeError("influxd is not installed")
    folder.mkdir()
    file, port = folder / "influxdb.conf", free_port()
    file.write_text(
        f'reporting-disabled = true\nbind-address = "127.0.0.1:{free_port()}"\n[meta]\ndir = "{folder}/meta"\n'
        f'[data]\ndir = "{folder}/data"\nwal-dir = "{folder}/wal"\n[monitor]\nstore-enabled = false\n'
        f'[http]\nbind-address = "127.0.0.1:{port}"\nlog-enabled = false\n'
    )
    url, quiet = f"http://127.0.0.1:{port}", subprocess.DEVNULL
    process = subprocess.Popen([INFLUXD, "-config", str(file)], stdout=quiet, stderr=quiet)
    try:
        _until_it_answers(f"{url}/query?q=CREATE+DATABASE+{DATABASE}", process)
        yield url
    finally:
        process.kill()
        process.wait()


def _until_it_answers(url: str, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + START
    while time.monotonic() < end and process.poll() is None:
        with suppress(OSError):
            urllib.request.urlopen(url, data=b"").close()
            return
        time.sleep(0.05)
    raise RuntimeError("influxd does not begin")
