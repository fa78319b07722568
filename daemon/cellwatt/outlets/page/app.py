"""The whole page as a web application: its files, logins, the plant, cells."""

from __future__ import annotations

import asyncio
import gzip
import hashlib
import mimetypes
import ssl
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from aiohttp import web
from aiohttp.typedefs import Handler

from cellwatt.door.http import HttpDoor
from cellwatt.door.port import Limits
from cellwatt.door.settings import tls_context
from cellwatt.outlets.page.access import LARGEST_BODY, Gate, answer, proof_of, refusal
from cellwatt.outlets.page.api import CellApi, body_of, text_of, visitor_of
from cellwatt.outlets.page.drop_api import DropApi
from cellwatt.outlets.page.dropped import Drops
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.sessions import LONGEST, Sessions
from cellwatt.outlets.page.streams import Browsers, encoded
from cellwatt.version import __version__

if TYPE_CHECKING:
    from cellwatt.outlets.page.plant import Rooms

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
"""Bytes of JSON from which on it is packed."""
LIMITS: Final = Limits(connections=384, peer=256)


class Page:
    """The application for ``rooms``; ``gate`` lets in, ``assets`` are its files, ``browsers`` those that follow.

    Recordings can be dropped on it where there are ``drops``.
    """

    def __init__(
        self,
        settings: PageSettings,
        gate: Gate,
        rooms: Rooms,
        assets: Assets,
        browsers: Browsers,
        drops: Drops | None = None,
    ) -> None:
        self._settings, self._gate, self._rooms, self._assets = settings, gate, rooms, assets
        self._browsers = browsers
        self._drops = None if drops is None else DropApi(drops, settings)
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
            *CellApi(self._rooms).routes(),
            *(self._drops.routes() if self._drops else ()),
        )

    async def _index(self, request: web.Request) -> web.StreamResponse:
        return self._assets.answer(request, INDEX)

    async def _asset(self, request: web.Request) -> web.StreamResponse:
        return self._assets.answer(request, request.path.removeprefix("/"))

    async def _site(self, request: web.Request) -> web.StreamResponse:
        visitor = visitor_of(request)
        known = visitor.name is not None or not self._settings.users
        told: dict[str, Any] = {
            "mode": self._rooms.mode,
            "site": self._rooms.site if known else None,
            "cells": [{"site": site, "cell": cell} for site, cell in self._rooms.cells] if known else [],
            "user": visitor.name,
            "may_act": visitor.may_act and self._rooms.acts,
            "may_drop": self._drops is not None and self._drops.may(request),
            "login_needed": not known,
            "csrf": self._gate.sessions.csrf(visitor.token),
            "version": __version__,
        }
        made = answer(told)
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
        return answer({"cells": self._rooms.summary()})

    async def _plant_stream(self, request: web.Request) -> web.StreamResponse:
        hub = self._rooms.hub
        if hub is None:
            return refusal(HTTPStatus.NOT_FOUND, "this page shows one cell: there is no plant to follow")
        first = [encoded("plant", {"cells": self._rooms.summary()})]
        return await hub.serve(request, None, 1.0, visitor_of(request).token, first)

    # serving --------------------------------------------------------------------------------------

    async def start(self, context: ssl.SSLContext | None) -> str:
        """Begin to serve; return the address. Raises ``OutletError`` if that cannot be."""
        self.url = f"{await self._door.start(context)}/"
        return self.url

    @property
    def counts(self) -> Mapping[str, int]:
        """Connections and logins that were refused, and what became of browsers."""
        return {**self._browsers.counts, **self._door.counts, **self._gate.counts}

    async def stop(self) -> None:
        """End all streams and serve no more."""
        self._browsers.end()
        await self._door.stop()


@asynccontextmanager
async def served(
    settings: PageSettings, rooms: Rooms, browsers: Browsers, logins: Path | None = None, drops: Drops | None = None
) -> AsyncIterator[Page]:
    """Serve a page until the end of the context; ``logins`` is the file that keeps them, if any does.

    Recordings can be dropped on it where there are ``drops``, which end with it.
    Raises ``OutletError`` if that cannot be.
    """
    sessions, assets = Sessions(logins, lambda name: proof_of(settings, name)), Assets()
    context, names, *_ = await asyncio.gather(
        asyncio.to_thread(tls_context, settings),
        asyncio.to_thread(names_in, settings.certificate),
        asyncio.to_thread(sessions.load),
        asyncio.to_thread(assets.load),
    )
    gate = Gate(settings, sessions, names)
    page = Page(settings, gate, rooms, assets, browsers, drops)
    try:
        await page.start(context)
        yield page
    finally:
        await page.stop()
        if drops is not None:
            await drops.close()
        await gate.save()


def names_in(certificate: Path | None) -> tuple[str, ...]:
    """Host names that a certificate is for; none where the package cryptography, which reads it, is missing."""
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
    """Pack long JSON for browsers that unpack it."""
    response = await handler(request)
    if isinstance(response, web.Response):
        body = response.body if response.content_type == "application/json" else None
        if isinstance(body, bytes) and len(body) > _PACKED:
            response.enable_compression()
    return response


FOLDER: Final = Path(__file__).parent / "static"
INDEX: Final = "index.html"
_SMALL: Final = 1024
"""Bytes below which nothing is packed."""
_IMMUTABLE: Final = "public, max-age=31536000, immutable"
_TYPES: Final = {".js": "text/javascript", ".woff2": "font/woff2", ".webmanifest": "application/manifest+json"}


@dataclass(frozen=True, slots=True)
class Asset:
    """One file, also packed, if that makes it smaller."""

    body: bytes
    packed: bytes | None
    type: str
    tag: str


class Assets:
    """The files of a folder by their path in it."""

    def __init__(self, folder: Path = FOLDER) -> None:
        self._folder = folder
        self._kept: dict[str, Asset] = {}

    def load(self) -> None:
        """Read all files; blocks."""
        files = [path for path in sorted(self._folder.rglob("*")) if path.is_file()]
        self._kept = {path.relative_to(self._folder).as_posix(): _asset(path) for path in files}

    def answer(self, request: web.Request, name: str) -> web.StreamResponse:
        """The file of a name; one below ``assets`` has its digest in its name and never changes."""
        asset = self._kept.get(name)
        if asset is None:
            if name == INDEX:
                return refusal(HTTPStatus.SERVICE_UNAVAILABLE, "the files of the page are missing: install it again")
            return refusal(HTTPStatus.NOT_FOUND, "there is no such file")
        kept = _IMMUTABLE if name.startswith("assets/") else "no-cache"
        headers = {"Cache-Control": kept, "ETag": asset.tag, "Vary": "Accept-Encoding", "Content-Type": asset.type}
        if request.headers.get("If-None-Match") == asset.tag:
            return web.Response(status=HTTPStatus.NOT_MODIFIED, headers=headers)
        if asset.packed is not None and "gzip" in request.headers.get("Accept-Encoding", ""):
            return web.Response(body=asset.packed, headers={**headers, "Content-Encoding": "gzip"})
        return web.Response(body=asset.body, headers=headers)


def _asset(path: Path) -> Asset:
    body = path.read_bytes()
    packed = gzip.compress(body, 9, mtime=0) if len(body) > _SMALL else body
    kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    if kind.startswith("text/"):
        kind = f"{kind}; charset=utf-8"
    tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    return Asset(body, packed if len(packed) < len(body) else None, kind, tag)
