"""Child processes of the tests, spoken to in JSON lines, and a TCP link that can be cut."""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tests.patience import PATIENCE, wait_until

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
    """A TCP relay from a port of its own to ``target``, which can be cut.

    ``streams`` has what was said to it, connection by connection.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        self.streams: list[bytearray] = []
        self._heard: dict[socket.socket, bytearray] = {}
        self._pairs: dict[socket.socket, socket.socket] = {}
        self._up = True
        self._ended = False
        self._dropped = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def cut(self) -> None:
        """Drop every connection; they are gone when this returns."""
        self._dropped.clear()
        self._up = False
        assert self._dropped.wait(PATIENCE), "the link was not cut"

    def restore(self) -> None:
        self._up = True

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()
        self._drop_all()
        self._server.close()

    def _run(self) -> None:
        while not self._ended:
            if not self._up:
                self._drop_all()
                self._dropped.set()
            watched = [self._server, *self._pairs]
            for ready in select.select(watched, [], [], 0.02)[0]:
                if ready is self._server:
                    self._accept()
                elif ready in self._pairs:
                    self._forward(ready)

    def _accept(self) -> None:
        near = self._server.accept()[0]
        if not self._up:
            near.close()
            return
        try:
            far = socket.create_connection(("127.0.0.1", self._target))
        except ConnectionRefusedError:  # the far process is starting anew: as a cut
            near.close()
            return
        self._pairs |= {near: far, far: near}
        self._heard[near] = bytearray()
        self.streams.append(self._heard[near])

    def _forward(self, source: socket.socket) -> None:
        try:
            data = source.recv(65536)
            if data:
                self._heard.get(source, bytearray()).extend(data)
                self._pairs[source].sendall(data)
                return
        except OSError:
            pass
        self._drop(source)

    def _drop(self, one: socket.socket) -> None:
        other = self._pairs.pop(one)
        self._pairs.pop(other)
        one.close()
        other.close()

    def _drop_all(self) -> None:
        while self._pairs:
            self._drop(next(iter(self._pairs)))
