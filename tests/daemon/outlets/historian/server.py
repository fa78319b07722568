"""A server that takes line protocol, and does what a test says."""

from __future__ import annotations

import gzip
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from aiohttp import web

from tests.daemon.outlets.historian.loopback import Loopback
from tests.daemon.outlets.historian.parsing import Point, parse


@dataclass
class Fake(Loopback):
    """Takes lines; ``answers`` are those to the next requests, ``refuses`` tells which lines it never takes."""

    answers: deque[tuple[int, str, dict[str, str]]] = field(default_factory=deque)
    refuses: Callable[[str], bool] = lambda _line: False
    requests: list[web.BaseRequest] = field(default_factory=list)
    batches: list[list[str]] = field(default_factory=list)
    points: dict[Any, Point] = field(default_factory=dict)

    async def take(self, request: web.BaseRequest) -> web.Response:
        body = await request.read()
        self.requests.append(request)
        if self.answers:
            status, text, headers = self.answers.popleft()
            return packed(web.Response(status=status, text=text, headers=headers))
        assert request.headers["Content-Encoding"] == "gzip"  # which the server of aiohttp may have unpacked
        lines = (gzip.decompress(body) if body[:2] == b"\x1f\x8b" else body).decode().split("\n")
        self.batches.append(lines)
        bad = [line for line in lines if self.refuses(line)]
        for point in map(parse, (line for line in lines if line not in bad)):
            self.points[point.measurement, tuple(sorted(point.tags.items())), point.time] = point
        if bad:
            told = {"error": f"partial write: field type conflict dropped={len(bad)}"}
            return packed(web.json_response(told, status=400))
        return web.Response(status=204)

    @property
    def rows(self) -> list[Point]:
        return sorted((p for p in self.points.values() if p.measurement == "cellwatt"), key=lambda p: p.time)


def packed(answer: web.Response) -> web.Response:
    """As InfluxDB answers those who let it."""
    answer.enable_compression()
    return answer
