"""Processes at a Zenoh router: the router, cells that publish, readers that count."""

from __future__ import annotations

import socket
import time
from array import array
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from capacity.children import orders, say
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark

SITE = "bench"
PATIENCE = 60.0
"""s in which a link must come about."""
SLOT = 0.001
"""s between two looks of the publisher at what is due."""


@dataclass(frozen=True, slots=True)
class Topic:
    """Messages of a cell: key within it, a second, payload in bytes."""

    key: str
    rate: float
    size: int


def free_port() -> int:
    """A free TCP port of this host."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def certificates(folder: Path) -> dict[str, str]:
    """Settings ``tls`` of a link, with certificates that are made for this run."""
    from cellwatt.certificates import issue, new_authority

    now = datetime.now(UTC)
    authority = new_authority(SITE, now)
    member = issue(authority, "member", ("localhost", "127.0.0.1"), now)
    files = {"root_ca": authority.certificate, "certificate": member.certificate, "key": member.key}
    for name, content in files.items():
        (folder / f"{name}.pem").write_bytes(content)
    return {name: str(folder / f"{name}.pem") for name in files}


def route(**link: Any) -> None:
    """A router: the same Rust core as zenohd, in the Python binding."""
    with open_session(LinkSettings(mode="router", **link)):
        say("ready")
        for _ in orders():
            say("ok")


def publish(link: Mapping[str, Any], cells: int, topics: Sequence[Mapping[str, Any]], first: int = 0) -> None:
    """Cells with a session each; an order is for how many s they publish, the answer what they sent."""
    kinds = [Topic(**topic) for topic in topics]
    with ExitStack() as stack:
        sources = []
        for number in range(first, first + cells):
            session = stack.enter_context(open_session(LinkSettings(mode="client", **link), patience=PATIENCE))
            sources.append(_Cell(session, f"cell-{number:03}", kinds, number / cells))
        say("ready")
        for seconds in orders():
            say(_published(sources, float(seconds)))


class _Cell:
    """A session that declares what a cell of ours declares, and its messages that are due."""

    def __init__(self, session: Any, name: str, topics: Sequence[Topic], phase: float) -> None:
        import zenoh

        keys = CellKeys(SITE, name)
        self._token = session.liveliness().declare_token(keys.root)
        self._answers = session.declare_queryable(f"{keys.root}/@/**", lambda query: query.drop())
        options = {
            "congestion_control": zenoh.CongestionControl.DROP,
            "priority": zenoh.Priority.DATA,
            "express": True,
        }
        self._topics = [
            (topic, session.declare_publisher(keys.live(topic.key), **options), bytes(topic.size), phase)
            for topic in topics
        ]
        self._sent = [0] * len(topics)

    def begin(self) -> None:
        self._sent = [0] * len(self._topics)

    def send(self, elapsed: float, until: float) -> tuple[int, int]:
        """Send what is due; return messages and bytes."""
        messages = size = 0
        for i, (topic, publisher, payload, phase) in enumerate(self._topics):
            due = int(min(elapsed, until) * topic.rate + phase)
            for number in range(self._sent[i], due):
                publisher.put(payload, attachment=Mark(1, number, 1, time.time_ns()).encode(payload))
            messages += due - self._sent[i]
            size += (due - self._sent[i]) * topic.size
            self._sent[i] = due
        return messages, size


def _published(cells: Sequence[_Cell], seconds: float) -> dict[str, float]:
    for cell in cells:
        cell.begin()
    messages = size = 0
    began, used = time.monotonic(), time.process_time()
    while True:
        elapsed = time.monotonic() - began
        for cell in cells:
            more, bytes_ = cell.send(elapsed, seconds)
            messages, size = messages + more, size + bytes_
        if elapsed >= seconds:
            break
        time.sleep(SLOT)
    return {"messages": messages, "bytes": size, "seconds": elapsed, "cpu": time.process_time() - used}


def read(link: Mapping[str, Any], keys: Sequence[str], sessions: int) -> None:
    """Readers with a session each; the answer to any order is what came since the last one."""
    with ExitStack() as stack:
        counts = [_Count() for _ in range(sessions)]
        for count in counts:
            session = stack.enter_context(open_session(LinkSettings(mode="client", **link), patience=PATIENCE))
            for key in keys:
                session.declare_subscriber(key, count.take)
        say("ready")
        for _ in orders():
            say([count.told() for count in counts])


class _Count:
    """Messages of one reader, by the first word of their topic, with the delay of frames."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        self._messages: dict[str, list[int]] = {}
        self._delays = array("q")
        self._numbers = array("q")

    def take(self, sample: Any) -> None:
        key, mark = str(sample.key_expr), sample.attachment.to_bytes()
        topic = key.split("/", 3)[3]
        count = self._messages.setdefault(topic, [0, 0])
        count[0] += 1
        count[1] += len(sample.payload)
        if topic == "frame":
            self._delays.append(time.time_ns() - int.from_bytes(mark[24:32], "little"))
            self._numbers.append(int.from_bytes(mark[16:24], "little"))

    def told(self) -> dict[str, Any]:
        messages, delays, numbers = self._messages, self._delays, np.array(self._numbers)
        self.begin()
        told: dict[str, Any] = {"topics": messages}
        if len(delays):
            late = np.array(delays) / 1e6
            told |= {"p50_ms": float(np.percentile(late, 50)), "p99_ms": float(np.percentile(late, 99))}
            told |= {"lost": int(numbers.max() - numbers.min() + 1 - len(np.unique(numbers)))}
        return told


def role(name: str, arguments: Mapping[str, Any]) -> None:
    """Be a process of the benchmark."""
    roles: Mapping[str, Callable[..., None]] = {"route": route, "publish": publish, "read": read}
    roles[name](**arguments)


def as_arguments(topics: Sequence[Topic]) -> list[dict[str, Any]]:
    """Topics as the publishing process takes them."""
    return [asdict(topic) for topic in topics]
