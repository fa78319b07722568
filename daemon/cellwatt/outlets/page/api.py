"""HTTP API of one cell: its state, streams, curves, alarms and reports; acknowledging and shelving alarms."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

from aiohttp import web

from cellwatt.outlets.page.cells import Cell, prefix
from cellwatt.outlets.page.gate import VISITOR, Visitor, answer, refusal
from cellwatt.outlets.page.reports import list_reports, newest_mismatch, report_file
from cellwatt.outlets.page.streams import encoded
from cellwatt.outlets.zenoh.messages import parse_json

if TYPE_CHECKING:
    from cellwatt.outlets.page.plant import Cells

CELL: Final = "/api/cells/{site}/{cell}"
REPORT_POLICY: Final = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Reports are separate pages with their own scripts; this policy denies them access to the page and its API."""
MOST_CHANNELS: Final = 100
MOST_POINTS: Final = 4000
MOST_ALARMS: Final = 1000
LONGEST_SHELF: Final = 31 * 24 * 60
"""Longest time, min, for which an alarm may be shelved."""
LONGEST_NAME, LONGEST_NOTE = 100, 1000
_RATES: Final = (0.1, 25.0)
_HOUR: Final = 3.6e6
LATEST: Final = 2**62 / 1e6
"""Latest time, ms, in the year 2116: later times overflow in ns."""


class CellApi:
    """HTTP API of the cells in ``cells``."""

    def __init__(self, cells: Cells) -> None:
        self._cells = cells

    def routes(self) -> Sequence[web.AbstractRouteDef]:
        """Routes below ``CELL``."""
        return (
            web.get(f"{CELL}/state", self._state),
            web.get(f"{CELL}/stream", self._stream, allow_head=False),
            web.get(f"{CELL}/curves", self._curves),
            web.get(f"{CELL}/alarms", self._alarms),
            web.get(f"{CELL}/reports", self._reports),
            web.get(f"{CELL}/reports/{{path:.+}}", self._report),
            web.get(f"{CELL}/mismatch", self._mismatch),
            web.post(f"{CELL}/{{what:acknowledge|shelve|unshelve}}", self._act),
        )

    async def _cell(self, request: web.Request) -> Cell:
        site, name = request.match_info["site"], request.match_info["cell"]
        try:
            return await self._cells.cell(site, name)
        except KeyError:
            raise web.HTTPNotFound(text=f"no cell is heard as {site:.100}/{name:.100}") from None

    async def _state(self, request: web.Request) -> web.StreamResponse:
        cell, visitor = await self._cell(request), visitor_of(request)
        may_act = visitor.may_act and cell.order is not None
        record = cell.archive.folder is not None
        return answer({**cell.feed.state(), "may_act": may_act, "record": record})

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        cell = await self._cell(request)
        rate = min(max(number(request, "rate", 10.0), _RATES[0]), _RATES[1])
        wanted = tuple(dict.fromkeys((*_channels(request), *cell.feed.joints)))
        status = cell.feed.live.status
        first = [encoded("health", status)] if status else []
        return await cell.feed.hub.serve(request, wanted, rate, visitor_of(request).token, first)

    async def _curves(self, request: web.Request) -> web.StreamResponse:
        cell = await self._cell(request)
        start, end = _span(request)
        points = round(min(max(number(request, "points", 1200), 1), MOST_POINTS))
        return answer(await cell.archive.curves(cell.feed.live, _channels(request), start, end, points))

    async def _alarms(self, request: web.Request) -> web.StreamResponse:
        cell = await self._cell(request)
        start, end = _span(request)
        limit = round(min(max(number(request, "limit", 200), 1), MOST_ALARMS))
        past = await cell.archive.alarms(cell.feed.live, start, end, limit)
        return answer(
            {**past, "alarms": [_addressed(cell, alarm, "evidence_page", "evidence_page") for alarm in past["alarms"]]}
        )

    async def _reports(self, request: web.Request) -> web.StreamResponse:
        cell = await self._cell(request)
        found = await cell.archive.reports(list_reports)
        return answer({**found, "reports": [_addressed(cell, report, "path", "href") for report in found["reports"]]})

    async def _report(self, request: web.Request) -> web.StreamResponse:
        cell = await self._cell(request)
        file = await cell.archive.reports(report_file, request.match_info["path"])
        if file is None:
            raise web.HTTPNotFound(text="there is no such report")
        return report_page(file)

    async def _mismatch(self, request: web.Request) -> web.StreamResponse:
        cell = await self._cell(request)
        return answer(_addressed(cell, await cell.archive.reports(newest_mismatch), "path", "href"))

    # acknowledge, shelve, unshelve ----------------------------------------------------------------

    async def _act(self, request: web.Request) -> web.StreamResponse:
        cell, visitor, what = await self._cell(request), visitor_of(request), request.match_info["what"]
        if cell.order is None:
            return refusal(HTTPStatus.FORBIDDEN, "acknowledge on the cell's own page")
        if not visitor.may_act:
            return refusal(HTTPStatus.FORBIDDEN, "this login may look, but not act: it needs may: act")
        body = await body_of(request)
        order: dict[str, Any] = {
            "what": what,
            "alarm": text_of(body, "id", 500),
            "name": visitor.name or text_of(body, "name", LONGEST_NAME),
            "note": text_of(body, "note", LONGEST_NOTE),
        }
        if what == "shelve":
            now = cell.feed.live.status.get("time", time.time_ns())  # the cell's clock, which the PC's may differ from
            order["until"] = now + round(_minutes(body) * 60e9)
        await cell.order(order)
        return answer({})


def report_page(file: Path) -> web.FileResponse:
    """A report as an answer, without access to the page."""
    headers = {"Content-Security-Policy": REPORT_POLICY, "Content-Type": "text/html; charset=utf-8"}
    return web.FileResponse(file, headers=headers)


def visitor_of(request: web.Request) -> Visitor:
    """The visitor who sent a request."""
    return request[VISITOR]


async def body_of(request: web.Request) -> Mapping[str, Any]:
    """The body of a request, a JSON object. Raises ``HTTPBadRequest``, ``HTTPUnsupportedMediaType``."""
    if request.content_type != "application/json":
        raise web.HTTPUnsupportedMediaType(text="expected a JSON object (Content-Type: application/json)")
    try:
        body = parse_json(await request.read())
    except ValueError:
        body = None
    if not isinstance(body, dict):
        raise web.HTTPBadRequest(text="expected a JSON object")
    return body


def text_of(body: Mapping[str, Any], name: str, longest: int) -> str:
    """A text field of a body without control characters, ``""`` if missing. Raises ``HTTPBadRequest`` if too long."""
    value = body.get(name) or ""
    if not isinstance(value, str) or len(value) > longest:
        raise web.HTTPBadRequest(text=f"{name}: expected a text of at most {longest} characters")
    return "".join(c if c.isprintable() else " " for c in value).strip()


def number(request: web.Request, name: str, default: float) -> float:
    """A number in the query of a request. Raises ``HTTPBadRequest``."""
    try:
        found = float(request.query.get(name, default))
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise web.HTTPBadRequest(text=f"{name}: expected a number")
    return found


def _channels(request: web.Request) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(name for name in request.query.get("channels", "").split(",") if name))
    if len(names) > MOST_CHANNELS:
        raise web.HTTPBadRequest(text=f"channels: expected at most {MOST_CHANNELS}")
    return names


def _span(request: web.Request) -> tuple[float, float]:
    """Start and end, UTC ms; by default the last hour. Raises ``HTTPBadRequest``."""
    end = number(request, "to", time.time() * 1e3)
    start = number(request, "from", end - _HOUR)
    if not 0 <= start < end < LATEST:
        raise web.HTTPBadRequest(text="from, to: expected two UTC times in ms, from before to")
    return start, end


def _minutes(body: Mapping[str, Any]) -> float:
    minutes = body.get("minutes")
    if isinstance(minutes, bool) or not isinstance(minutes, int | float) or not 0 < minutes <= LONGEST_SHELF:
        raise web.HTTPBadRequest(text=f"minutes: expected a number above 0 and up to {LONGEST_SHELF}")
    return float(minutes)


def _addressed(cell: Cell, found: Mapping[str, Any], path: str, name: str) -> dict[str, Any]:
    """The fields of an answer; if ``path`` in it names a report, ``name`` becomes the URL of that report."""
    if not found.get(path):
        return dict(found)
    return {**found, name: f"{prefix(cell.feed.site, cell.feed.cell)}/reports/{quote(found[path], errors='replace')}"}
