"""Child processes of the tests, spoken to in JSON lines, and a TCP link that can be cut."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

from cellwatt.emulation.relay import clients, pass_on
from tests.patience import PATIENCE, wait_until

T = TypeVar("T")
ROOT = Path(__file__).resolve().parents[4]


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Child:
    """A module run as a process, ``within`` a command; what it prints, one JSON value a line, is in ``said``."""

    def __init__(self, module: str, within: Sequence[str] = (), /, **settings: Any) -> None:
        self.said: Any = []
        self._name = module
        package = "tests.daemon.outlets.zenoh"
        command = [*within, sys.executable, "-m", f"{package}.{module}", json.dumps(settings)]
        self._process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.endswith("\n"):  # or it was killed while it spoke
                self.said.append(json.loads(line))

    @property
    def pid(self) -> int:
        return self._process.pid

    def send(self, **order: Any) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()

    def wait_for(self, condition: Callable[[Any], bool], what: str, timeout: float = PATIENCE) -> Any:
        return self.until(lambda: next((s for s in list(self.said) if condition(s)), None), what, timeout)

    def until(self, condition: Callable[[], Any], what: str, timeout: float = PATIENCE) -> Any:
        def found() -> Any:
            ended, value = self._process.poll() is not None, condition()
            assert value or not ended, f"{self._name} ended before: {what}"
            return value

        return wait_until(found, what, timeout)

    def ready(self) -> Child:
        self.wait_for(lambda s: s == "ready", "ready")
        return self

    def finish(self, timeout: float = PATIENCE) -> int:
        """Close its input; it must end by itself."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        code = self._process.wait(timeout)
        self._reader.join()
        return code

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


class Link:
    """A TCP relay from a port of its own to ``target``, which can be cut; it runs on a loop in a thread of its own.

    ``streams`` has what was said to it, connection by connection.
    """

    def __init__(self, target: int) -> None:
        self._target = f"127.0.0.1:{target}"
        self.streams: list[bytearray] = []
        self._up = True
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)

    def __enter__(self) -> Self:
        self._thread.start()
        self._clients = clients(self._talk)
        address, self._talking = self._do(self._clients.__aenter__())
        self.port = int(address.rpartition(":")[2])
        return self

    def __exit__(self, *_: object) -> None:
        self._do(self._clients.__aexit__(None, None, None))
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def cut(self) -> None:
        """Drop every connection; they are gone when this returns."""
        self._up = False
        self._do(self._drop())

    def restore(self) -> None:
        self._up = True

    async def _drop(self) -> None:
        talking = list(self._talking)
        for task in talking:
            task.cancel()
        await asyncio.gather(*talking, return_exceptions=True)

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        heard = bytearray()

        async def see(data: bytes) -> None:
            if not heard:
                self.streams.append(heard)
            heard.extend(data)

        if self._up:
            await pass_on(reader, writer, self._target, see)

    def _do(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE)
