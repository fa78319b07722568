"""The page as a web application: static files, logins, the plant, cells."""

from __future__ import annotations

import asyncio
import hashlib
import mimetypes
import ssl
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from aiohttp import web
from aiohttp.typedefs import Handler

from cellwatt.door.http import HttpDoor
from cellwatt.door.port import Limits
from cellwatt.door.settings import tls_context
from cellwatt.outlets.page.api import CellApi, body_of, text_of, visitor_of
from cellwatt.outlets.page.dropped import Drops
from cellwatt.outlets.page.gate import LARGEST_BODY, Gate, answer, proof_of, refusal
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.sessions import LONGEST, Sessions
from cellwatt.outlets.page.streams import Browsers, encoded
from cellwatt.version import __version__

if TYPE_CHECKING:
    from cellwatt.outlets.page.plant import Cells

PAGES: Final = (
    "/",
    "/plant",
    "/login",
    "/cell/{site}/{cell}",
    "/cell/{site}/{cell}/{part}",
    "/recordings",
    "/recordings/{name}",
)
_PACKED: Final = 1024
"""Size, bytes, above which an answer is compressed."""
LIMITS: Final = Limits(connections=384, peer=256)


class Page:
    """The application for ``cells``; ``gate`` checks requests, ``assets`` are the static files, ``browsers`` the
    connected browsers.

    With ``drops``, recordings can be dropped on the page.
    """

    def __init__(
        self,
        settings: PageSettings,
        gate: Gate,
        cells: Cells,
        assets: Assets,
        browsers: Browsers,
        drops: Drops | None = None,
    ) -> None:
        self._settings, self._gate, self._cells, self._assets = settings, gate, cells, assets
        self._browsers = browsers
        self._drops = drops
        self._door = HttpDoor(self.application(), settings, LIMITS, self._drops.put if self._drops else None)
        self.url = ""

    def application(self) -> web.Application:
        """The aiohttp application."""
        app = web.Application(client_max_size=LARGEST_BODY, middlewares=[_pack, self._gate.middleware])
        app.on_response_prepare.append(self._gate.prepare)
        app.add_routes(self._routes())
        return app

    def _routes(self) -> Sequence[web.AbstractRouteDef]:
        return (
            *(web.get(path, self._index) for path in PAGES),
            web.get("/assets/{name:.+}", self._asset),
            web.get("/favicon.svg", self._asset),
            web.get("/api/site", self._site),
            web.post("/api/login", self._log_in),
            web.post("/api/logout", self._log_out),
            web.get("/api/plant", self._plant),
            web.get("/api/plant/stream", self._plant_stream, allow_head=False),
            *CellApi(self._cells).routes(),
            *(self._drops.routes(self._may_drop) if self._drops else ()),
        )

    def _may_drop(self, request: web.Request) -> bool:
        """True if the visitor may drop recordings."""
        return self._settings.local and visitor_of(request).may_act

    async def _index(self, request: web.Request) -> web.StreamResponse:
        return self._assets.answer(request, INDEX)

    async def _asset(self, request: web.Request) -> web.StreamResponse:
        return self._assets.answer(request, request.path.removeprefix("/"))

    async def _site(self, request: web.Request) -> web.StreamResponse:
        visitor = visitor_of(request)
        known = visitor.name is not None or not self._settings.users
        body: dict[str, Any] = {
            "mode": self._cells.mode,
            "site": self._cells.site if known else None,
            "cells": [{"site": site, "cell": cell} for site, cell in self._cells.names] if known else [],
            "user": visitor.name,
            "may_act": visitor.may_act and self._cells.acts,
            "may_drop": self._drops is not None and self._may_drop(request),
            "login_needed": not known,
            "csrf": self._gate.sessions.csrf(visitor.token),
            "version": __version__,
        }
        made = answer(body)
        if visitor.new:
            self._gate.set_cookie(made, visitor.token)
        if self._gate.sessions.changed:
            await self._gate.save()
        return made

    async def _log_in(self, request: web.Request) -> web.StreamResponse:
        body = await body_of(request)
        name, password = text_of(body, "name", 100), body.get("password")
        if not isinstance(password, str) or not 0 < len(password) <= LONGEST:
            raise web.HTTPBadRequest(text=f"password: expected a text of 1 to {LONGEST} characters")
        return await self._gate.log_in(request, name, password)

    async def _log_out(self, request: web.Request) -> web.StreamResponse:
        token = visitor_of(request).token
        made = await self._gate.log_out(request)
        self._browsers.end(lambda login: login == token)
        return made

    async def _plant(self, request: web.Request) -> web.StreamResponse:
        return answer({"cells": self._cells.summary()})

    async def _plant_stream(self, request: web.Request) -> web.StreamResponse:
        hub = self._cells.hub
        if hub is None:
            return refusal(HTTPStatus.NOT_FOUND, "this page shows one cell, not a plant")
        first = [encoded("plant", {"cells": self._cells.summary()})]
        return await hub.serve(request, (), 1.0, visitor_of(request).token, first)

    # serving --------------------------------------------------------------------------------------

    async def start(self, context: ssl.SSLContext | None) -> None:
        """Start to serve at ``url``. Raises ``OutletError`` if the page cannot be served."""
        self.url = f"{await self._door.start(context)}/"

    @property
    def counts(self) -> Mapping[str, int]:
        """Counts of refused connections and logins, and of browsers that were refused or too slow."""
        return {**self._browsers.counts, **self._door.counts, **self._gate.counts}

    async def stop(self) -> None:
        """End all streams and stop serving."""
        self._browsers.end()
        await self._door.stop()


@asynccontextmanager
async def served(
    settings: PageSettings, cells: Cells, browsers: Browsers, logins: Path | None = None, drops: Drops | None = None
) -> AsyncIterator[Page]:
    """Serve a page until the end of the context; ``logins`` is the file that stores logins, if any.

    With ``drops``, recordings can be dropped on the page; they are closed with it. Raises ``OutletError`` if the page
    cannot be served.
    """
    sessions, assets = Sessions(logins, lambda name: proof_of(settings, name)), Assets()
    context, names, *_ = await asyncio.gather(
        asyncio.to_thread(tls_context, settings),
        asyncio.to_thread(names_in, settings.certificate),
        asyncio.to_thread(sessions.load),
        asyncio.to_thread(assets.load),
    )
    gate = Gate(settings, sessions, names)
    page = Page(settings, gate, cells, assets, browsers, drops)
    try:
        await page.start(context)
        yield page
    finally:
        await page.stop()
        if drops is not None:
            await drops.close()
        await gate.save()


def names_in(certificate: Path | None) -> tuple[str, ...]:
    """Host names of a certificate; () if it cannot be read or the package cryptography is missing."""
    if certificate is None:
        return ()
    try:
        from cryptography import x509
    except ImportError:
        return ()
    try:
        found = x509.load_pem_x509_certificates(certificate.read_bytes())[0]
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        return tuple(names.get_values_for_type(x509.DNSName))
    except (OSError, ValueError, x509.ExtensionNotFound):
        return ()


@web.middleware
async def _pack(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Compress long answers for browsers that accept it."""
    response = await handler(request)
    if isinstance(response, web.Response) and isinstance(response.body, bytes) and len(response.body) > _PACKED:
        response.headers["Vary"] = "Accept-Encoding"
        response.enable_compression()
    return response


FOLDER: Final = Path(__file__).parent / "static"
INDEX: Final = "index.html"
_IMMUTABLE: Final = "public, max-age=31536000, immutable"


class Assets:
    """The static files of the page, by path relative to ``FOLDER``."""

    def __init__(self) -> None:
        self._files: dict[str, bytes] = {}

    def load(self) -> None:
        """Read all files; blocks."""
        files = [path for path in FOLDER.rglob("*") if path.is_file()]
        self._files = {path.relative_to(FOLDER).as_posix(): path.read_bytes() for path in files}

    def answer(self, request: web.Request, name: str) -> web.StreamResponse:
        """Answer with the named file; the name of a file below ``assets`` contains its digest, so it never changes."""
        body = self._files.get(name)
        if body is None:
            if name == INDEX:
                return refusal(HTTPStatus.SERVICE_UNAVAILABLE, "the files of the page are missing: install it again")
            return refusal(HTTPStatus.NOT_FOUND, "there is no such file")
        tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
        headers = {"Cache-Control": _IMMUTABLE if name.startswith("assets/") else "no-cache", "ETag": tag}
        if request.headers.get("If-None-Match") == tag:
            return web.Response(status=HTTPStatus.NOT_MODIFIED, headers=headers)
        kind = "text/javascript" if name.endswith(".js") else mimetypes.guess_type(name)[0]
        charset = "utf-8" if kind is not None and kind.startswith("text/") else None
        return web.Response(body=body, headers=headers, content_type=kind, charset=charset)
