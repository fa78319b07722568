"""What InfluxDB answers: status, Retry-After, and a body with its reason."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Final

from cellwatt.outlets.historian.client import judge
from cellwatt.outlets.remote import LONGEST_WAIT, NotNowError, RefusedError
from fuzz.target import Target

STATUS: Final = (200, 204, 400, 401, 404, 413, 422, 429, 500, 503)
NOW: Final = datetime(2026, 11, 24, tzinfo=UTC)


def run(data: bytes) -> None:
    """A byte for the status, the header up to a line break, the body."""
    header, _, body = data[1:].partition(b"\n")
    headers = {"Retry-After": header.decode("utf-8", "surrogateescape")} if header else {}
    try:
        judge(STATUS[(data or b"\0")[0] % len(STATUS)], body.decode("utf-8", "replace"), headers)
    except (NotNowError, RefusedError) as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 600
        wait = error.wait if isinstance(error, NotNowError) else None
        assert wait is None or 0.0 <= wait <= LONGEST_WAIT


def seeds() -> Iterable[bytes]:
    """Answers of versions 1 and 2, of proxies, and what no server should say."""
    for number, header, body in (
        (1, "", ""),
        (2, "", '{"error": "partial write: field type conflict dropped=1"}'),
        (6, "", '{"code": "invalid", "message": "unable to parse"}'),
        (7, "30", '{"error": null}'),
        (9, "Wed, 25 Nov 2026 07:28:00 GMT", "<html>\n<h1>busy</h1>"),
        (9, "5 Nov 01 01:28777777777777777 GMT", ""),
        (9, "1e400", "[" * 3000),
        (9, "Wed, 25 Nov 0000 07:28:00 -9999", '["a"]'),
    ):
        yield bytes([number]) + header.encode() + b"\n" + body.encode()


TARGET = Target(run, seeds, 4096)
