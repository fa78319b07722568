"""InfluxDB: rows and results in line protocol, sent as requests of one batch of lines each.

A backslash in tags and names becomes a slash, because version 1 cannot represent one before a comma or at the end;
a line break there becomes a blank.
"""

from __future__ import annotations

import asyncio
import base64
import gzip
import http.client
import logging
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from ssl import SSLContext
from typing import Final

import aiohttp

from cellwatt.errors import why
from cellwatt.files import put_aside
from cellwatt.outlets.forward import Peer
from cellwatt.outlets.historian.settings import InfluxSettings
from cellwatt.outlets.past import Archived
from cellwatt.outlets.remote import NotNowError, RefusedError, trust, unreached, wait_of
from cellwatt.outlets.selection import Row
from cellwatt.outlets.zenoh.messages import encode_json, parse_json
from cellwatt.results import Alarm, Energy, Task

log = logging.getLogger(__name__)

_EFFORT: Final = 1
"""Compression level of gzip: 3 times as fast as level 5 for an eighth more bytes."""
_LONGEST_ANSWER: Final = 64_000
_LONGEST_REASON: Final = 500
_WRITTEN: Final = (200, 204)
_REFUSED: Final = (400, 413, 422)
"""413: too large for the server, in one request."""
_PARTIAL: Final = "partial write: "
"""Words of an answer with status 500, by early releases of version 2: lines were refused for good, for a reason that
follows. A cluster with a node down answers ``partial write`` alone: the same lines are accepted later."""
REFUSED: Final = "historian-refused.txt"
"""File of the lines that the server refuses for good, with the reasons."""
LARGEST: Final = 16_000_000
"""Largest size of that file, bytes."""
TRIES: Final = 64
"""Most requests to find the bad lines of a batch; after that, its remaining lines count as refused."""


class Influx(Peer[str]):
    """Sends lines to one database or bucket while the context is open; refused lines are stored in ``folder``."""

    def __init__(self, settings: InfluxSettings, tags: Mapping[str, str], folder: Path | None) -> None:
        self._settings, self._tags, self._folder = settings, tags, folder
        self._session: aiohttp.ClientSession | None = None
        self._context: SSLContext | bool = True

    async def __aenter__(self) -> Influx:
        if self._settings.ca is not None:
            self._context = await asyncio.to_thread(trust, self._settings.ca)
        timeout = aiohttp.ClientTimeout(total=self._settings.timeout)
        self._session = aiohttp.ClientSession(timeout=timeout, auto_decompress=False)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._session is not None:
            await self._session.close()

    def row(self, row: Row, units: Mapping[str, str]) -> str | None:
        """See ``Peer.row``."""
        return row_line(self._settings.measurement, self._tags, row) or None

    def result(self, result: Archived) -> str | None:
        """See ``Peer.result``."""
        return result_line(self._settings.measurement, self._tags, result) or None

    async def send(self, messages: Sequence[str]) -> Mapping[str, int]:
        """See ``Peer.send``; refused lines are found by bisection.

        Sending the halves of a batch again is safe: writing a point twice gives the same point.
        """
        parts, tries, refused = [list(messages)], 0, 0
        while parts:
            part, tries = parts.pop(), tries + 1
            try:
                await self._write(part)
            except NotNowError as error:
                raise NotNowError(f"{self._settings.url}: {error}", error.wait) from None
            except RefusedError as error:
                half = len(part) // 2
                if half and tries < TRIES:
                    parts += [part[half:], part[:half]]
                else:
                    await asyncio.to_thread(_refused, self._folder, part, str(error))
                    refused += len(part)
        return {"refused": refused} if refused else {}

    async def _write(self, lines: Sequence[str]) -> None:
        """Send lines once. Raises ``NotNowError``, or ``RefusedError`` if at least one is refused for good."""
        body = await asyncio.to_thread(_packed, lines)
        url, params = place_of(self._settings)
        assert self._session is not None
        try:
            async with self._session.post(
                url, params=params, data=body, headers=self._headers(), ssl=self._context, allow_redirects=False
            ) as answer:
                text = (await answer.content.read(_LONGEST_ANSWER)).decode("utf-8", "replace")
                judge(answer.status, text, answer.headers)
        except TimeoutError:
            raise NotNowError(f"no answer within {self._settings.timeout:g} s") from None
        except (aiohttp.ClientError, OSError) as error:
            raise NotNowError(unreached(error)) from None

    def _headers(self) -> dict[str, str]:
        settings = self._settings
        found = {"Content-Encoding": "gzip", "Content-Type": "text/plain; charset=utf-8"}
        found["Accept-Encoding"] = "identity"  # uncompressed, so that the reason of a refusal cannot unpack to more
        if settings.token is not None:
            found["Authorization"] = f"Token {settings.token.get_secret_value()}"
        elif settings.user is not None and settings.password is not None:
            shown = f"{settings.user}:{settings.password.get_secret_value()}".encode()
            found["Authorization"] = f"Basic {base64.b64encode(shown).decode()}"
        return found


def _refused(folder: Path | None, lines: Sequence[str], reason: str) -> None:
    """Store refused lines below the reason; without a folder, only log them. Blocks."""
    log.warning("influx: %d lines are refused permanently: %s", len(lines), reason)
    if folder is not None:
        content = "\n".join((f"# {' '.join(reason.split())}", *lines, "")).encode()
        try:
            put_aside(folder / REFUSED, content, LARGEST, 0o644)
        except OSError as error:
            log.warning("influx: %s cannot be written: %s", folder / REFUSED, why(error))


def place_of(settings: InfluxSettings) -> tuple[str, dict[str, str]]:
    """URL and query of a write."""
    if settings.database is not None:
        policy = {} if settings.policy is None else {"rp": settings.policy}
        return f"{settings.url}/write", {"db": settings.database, **policy, "precision": "ns"}
    org, bucket = str(settings.org), str(settings.bucket)
    return f"{settings.url}/api/v2/write", {"org": org, "bucket": bucket, "precision": "ns"}


def judge(status: int, text: str, headers: Mapping[str, str]) -> None:
    """Raise ``NotNowError`` or ``RefusedError`` unless the server's answer means that all lines are written."""
    if status in _WRITTEN:
        return
    reason = f"{status}: {reason_of(text) or http.client.responses.get(status, 'no reason given')}"
    if status in range(300, 400):
        reason = f"{reason}; redirects are not followed: set the final address in url"
    if status in _REFUSED or (status == 500 and _PARTIAL in reason):
        raise RefusedError(reason)
    raise NotNowError(reason, wait_of(headers.get("Retry-After"), datetime.now(UTC)))


def reason_of(text: str) -> str:
    """The reason in a server's answer."""
    try:
        body = parse_json(text.encode())
    except ValueError:
        return _short(text)
    found = body.get("error") or body.get("message") if isinstance(body, dict) else None
    return _short(str(found or text))


def _packed(lines: Sequence[str]) -> bytes:
    return gzip.compress("\n".join(lines).encode(), _EFFORT)


def _short(text: str) -> str:
    return " ".join(text.split())[:_LONGEST_REASON]


Value = float | int | bool | str

_KEY: Final = {ord(c): f"\\{c}" for c in ",= "} | {ord("\\"): "/", ord("\n"): "\\ ", ord("\r"): "\\ "}
_MEASUREMENT: Final = {**_KEY, ord("="): "="}
_TEXT: Final = {ord('"'): '\\"', ord("\\"): "\\\\"}
_LONGEST: Final = 4000
"""Most characters of a text; version 1 refuses more than 64 kB."""


def line(measurement: str, tags: Mapping[str, str | None], fields: Mapping[str, Value | None], time: int) -> str:
    """One point at ``time``, UTC ns; empty if no field has a value. Tags without a value are omitted."""
    values = {key: text for key, value in fields.items() if (text := _value(value))}
    if not values:
        return ""
    body = ",".join(f"{_word(key)}={text}" for key, text in values.items())
    return f"{_series(measurement, tags)} {body} {time}"


def row_line(measurement: str, tags: Mapping[str, str], row: Row) -> str:
    """A row: its channels as fields, and ``quality``, the worst of the values present."""
    fields = [f"{_word(name)}={value!r}" for name, value in row.values.items()]
    return f"{_series(measurement, tags)} {','.join(fields)},quality={row.worst}i {row.time}" if fields else ""


def result_line(measurement: str, tags: Mapping[str, str], result: Archived) -> str:
    """An alarm, task or energy, in the measurement with ``_alarm``, ``_task`` or ``_energy`` appended."""
    match result:
        case Alarm():
            more = {key: getattr(result, key) for key in ("id", "kind", "severity", "source", "stage")}
            fields = {key: getattr(result, key) for key in ("active", "since", "statement", "joint")}
            fields["evidence"] = encode_json(dict(result.evidence)).decode()
            return line(f"{measurement}_alarm", {**tags, **more}, fields, result.time)
        case Task():
            more = {"source": result.source, "task": result.name, "variant": result.variant}
            seconds = (result.end - result.start) * 1e-9
            values = {"speed": result.speed, "seconds": seconds, "repetition": result.repetition}
            return line(f"{measurement}_task", {**tags, **more}, {**values, "signature": result.signature}, result.end)
        case Energy():
            more = {key: getattr(result, key) for key in ("source", "task", "variant")}
            names = ("total", "uncertainty", "positive_mechanical", "motion_efficiency_percent", "repetition")
            fields = {name: getattr(result, name) for name in names}
            fields |= {f"group.{name}": value for name, value in result.groups.items()}
            return line(f"{measurement}_energy", {**tags, **more}, fields, result.end)


def _series(measurement: str, tags: Mapping[str, str | None]) -> str:
    words = [f"{_word(key)}={_word(value)}" for key, value in sorted(tags.items()) if value]
    return ",".join((measurement.translate(_MEASUREMENT), *words))


@lru_cache(4096)
def _word(text: str) -> str:
    """An escaped name or tag, cached."""
    return text.translate(_KEY)


def _value(value: Value | None) -> str:
    """A field's value as text; empty if line protocol cannot represent it."""
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return f"{value}i"
        case float():
            return repr(float(value)) if math.isfinite(value) else ""
        case str():
            return f'"{value[:_LONGEST].translate(_TEXT)}"'
        case None:
            return ""
