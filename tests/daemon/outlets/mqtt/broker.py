"""A real Mosquitto as a process, and somebody who listens there."""

from __future__ import annotations

import asyncio
import getpass
import os
import shutil
import signal
import socket
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import aiomqtt
import pytest

from tests.daemon.outlets.zenoh.processes import free_port
from tests.patience import eventually, wait_until

PROGRAM = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
needs_mosquitto = pytest.mark.skipif(PROGRAM is None, reason="the program mosquitto is not installed")


class Broker:
    """Mosquitto on a port of its own; ``settings`` are further lines of its file."""

    def __init__(self, folder: Path, *settings: str) -> None:
        self._file = folder / "mosquitto.conf"
        self._lines = [
            f"user {getpass.getuser()}",
            "max_queued_messages 0",
            "set_tcp_nodelay true",
            "persistence false",
            *(() if "allow_anonymous false" in settings else ("allow_anonymous true",)),
            *settings,
        ]
        self._process: subprocess.Popen[bytes] | None = None
        self._known = False
        """True once others may know the port."""
        self._listen()

    def _listen(self) -> None:
        self.port = free_port()
        self._file.write_text("\n".join([f"listener {self.port} 127.0.0.1", *self._lines]) + "\n")

    @property
    def url(self) -> str:
        return f"mqtt://127.0.0.1:{self.port}"

    def start(self) -> None:
        self._launch()
        if self._ended and not self._known:  # another process took the port meanwhile
            self._listen()
            self._launch()
        assert not self._ended, "Mosquitto ended"
        self._known = True

    def _launch(self) -> None:
        assert PROGRAM is not None
        self._process = subprocess.Popen(
            [PROGRAM, "-c", str(self._file)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wait_until(lambda: self._ended or self._listens(), "Mosquitto listens")

    @property
    def _ended(self) -> bool:
        return self._process is None or self._process.poll() is not None

    def _listens(self) -> bool:
        with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), timeout=1):
            return True
        return False

    def kill(self) -> None:
        """End at once, and forget all."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    async def again(self) -> None:
        """Start once more, from a loop."""
        await asyncio.to_thread(self.start)

    def hang(self) -> None:
        """Take connections, as the kernel does, and say nothing."""
        assert self._process is not None
        os.kill(self._process.pid, signal.SIGSTOP)


@asynccontextmanager
async def started(folder: Path, *settings: str) -> AsyncIterator[Broker]:
    """A broker that is killed in the end."""
    broker = Broker(folder, *settings)
    await broker.again()
    try:
        yield broker
    finally:
        broker.kill()


class Heard(NamedTuple):
    topic: str
    payload: bytes
    retain: bool


class Ears:
    """Hears topics of a broker, and speaks."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self.client = client
        self.heard: list[Heard] = []

    def of(self, topic: str) -> list[bytes]:
        """Payloads of topics that match."""
        return [m.payload for m in self.heard if aiomqtt.Topic(m.topic).matches(topic)]

    def topics(self) -> list[str]:
        return [m.topic for m in self.heard]

    async def until(self, topic: str, count: int = 1) -> list[bytes]:
        await eventually(lambda: len(self.of(topic)) >= count, f"{count} of {topic}; heard {self.topics()[-20:]}")
        return self.of(topic)

    async def say(self, topic: str, payload: bytes, retain: bool = False) -> None:
        await self.client.publish(topic, payload, 1, retain)


@asynccontextmanager
async def ears(broker: Broker, *topics: str, **more: object) -> AsyncIterator[Ears]:
    """Somebody who listens to ``topics``, as they are published: also to whether they are retained."""
    client = aiomqtt.Client("127.0.0.1", broker.port, protocol=aiomqtt.ProtocolVersion.V5, **more)  # type: ignore[arg-type]
    async with client:
        found = Ears(client)
        options = aiomqtt.client.SubscribeOptions(qos=2, retainAsPublished=True)
        await client.subscribe([(topic, options) for topic in topics or ("#",)])  # type: ignore[arg-type]

        async def listen() -> None:
            with suppress(aiomqtt.MqttError):
                async for message in client.messages:
                    found.heard.append(Heard(str(message.topic), message.payload, message.retain))  # type: ignore[arg-type]

        listening = asyncio.create_task(listen())
        try:
            yield found
        finally:
            listening.cancel()
            await asyncio.wait([listening])
            if client._client.socket() is None and not client._disconnected.done():
                client._disconnected.set_result(None)
