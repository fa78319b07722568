"""Answers about recordings that are dropped on the page, to whoever sits at this PC and may act."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from typing import Any, Final

from aiohttp import web

from cellwatt.door.http import BODY
from cellwatt.errors import CellwattError
from cellwatt.outlets.page.access import answer
from cellwatt.outlets.page.api import REPORT_POLICY, body_of, visitor_of
from cellwatt.outlets.page.dropped import Drop, Drops
from cellwatt.outlets.page.outlet import PageSettings

ROOT: Final = "/api/recordings"
DROP: Final = f"{ROOT}/{{name:\\d+}}"


class DropApi:
    """Answers about ``drops``; refused to others than this PC by the page's ``settings``."""

    def __init__(self, drops: Drops, settings: PageSettings) -> None:
        self._drops, self._settings = drops, settings

    def routes(self) -> Sequence[web.AbstractRouteDef]:
        """Routes below ``ROOT``."""
        return (
            web.get(ROOT, self._all),
            web.post(ROOT, self._open),
            web.post(f"{ROOT}/sample", self._sample),
            web.get(DROP, self._one),
            web.put(f"{DROP}/files/{{path:.+}}", self.put),
            web.post(f"{DROP}/curves/{{path:.+}}", self._draw),
            web.get(f"{DROP}/curves/{{path:.+}}", self._curves),
            web.post(f"{DROP}/explain", self._explain),
            web.get(f"{DROP}/result/{{file}}", self._result),
        )

    def may(self, request: web.Request) -> bool:
        """True for whoever may drop recordings."""
        return self._settings.local and visitor_of(request).may_act

    def _checked(self, request: web.Request) -> None:
        if not self.may(request):
            raise web.HTTPForbidden(text="recordings are dropped on a page of this PC, by those who may act")

    def _drop(self, request: web.Request) -> Drop:
        self._checked(request)
        try:
            return self._drops[request.match_info["name"]]
        except KeyError:
            raise web.HTTPNotFound(text="these recordings are no longer kept: drop them again") from None

    async def _all(self, request: web.Request) -> web.StreamResponse:
        self._checked(request)
        return answer({"drops": self._drops.names})

    async def _open(self, request: web.Request) -> web.StreamResponse:
        self._checked(request)
        body = await body_of(request)
        files, into = body.get("files"), body.get("into")
        if not isinstance(files, dict) or not all(isinstance(n, int) and n >= 0 for n in files.values()):
            raise web.HTTPBadRequest(text="files: expected a size in bytes for each path")
        known = self._drops[into] if isinstance(into, str) and into in self._drops.names else None
        return answer({"name": (await self._drops.open(files, known)).name})

    async def put(self, request: web.Request) -> web.StreamResponse:
        """Take a file in pieces; the door leaves its body alone."""
        await self._drops.take(self._drop(request), request.match_info["path"], _pieces(request))
        return answer({})

    async def _sample(self, request: web.Request) -> web.StreamResponse:
        self._checked(request)
        return answer({"name": (await self._drops.sample()).name})

    async def _one(self, request: web.Request) -> web.StreamResponse:
        return answer(await asyncio.to_thread(self._drop(request).told))

    async def _draw(self, request: web.Request) -> web.StreamResponse:
        await self._drops.draw(self._drop(request), request.match_info["path"])
        return answer({})

    async def _curves(self, request: web.Request) -> web.StreamResponse:
        drawn = self._drop(request).drawn.get(request.match_info["path"])
        if drawn is None:
            raise web.HTTPNotFound(text="this recording is not drawn")
        return _page(drawn)

    async def _explain(self, request: web.Request) -> web.StreamResponse:
        drop, body = self._drop(request), await body_of(request)
        await self._drops.explain(
            drop, _paths(body, "recordings"), _paths(body, "simulations"), str(body.get("robot") or "")
        )
        return answer({})

    async def _result(self, request: web.Request) -> web.StreamResponse:
        drop, name = self._drop(request), request.match_info["file"]
        made = await asyncio.to_thread(lambda: {path.name: path for path in drop.result.glob("*")})
        if (file := made.get(name)) is None:
            raise web.HTTPNotFound(text="there is no such file")
        if file.suffix == ".html":
            return _page(file)
        headers = {"Content-Disposition": "attachment", "Content-Type": "application/octet-stream"}
        return web.FileResponse(file, headers=headers)


def _page(file: Any) -> web.FileResponse:
    return web.FileResponse(
        file, headers={"Content-Security-Policy": REPORT_POLICY, "Content-Type": "text/html; charset=utf-8"}
    )


def _paths(body: Any, name: str) -> list[str]:
    found = body.get(name)
    if not isinstance(found, list) or not all(isinstance(path, str) for path in found):
        raise web.HTTPBadRequest(text=f"{name}: expected paths of files that were dropped")
    return found


async def _pieces(request: web.Request) -> AsyncIterator[bytes]:
    """The body as it comes. Raises ``CellwattError`` where it stops coming."""
    while True:
        try:
            async with asyncio.timeout(BODY):
                piece = await request.content.readany()
        except (TimeoutError, OSError, web.HTTPException) as error:
            raise CellwattError("the file broke off on its way: drop it again") from error
        if not piece:
            return
        yield piece
