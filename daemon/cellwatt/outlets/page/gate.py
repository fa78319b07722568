"""Access control of the page: hosts, origins, logins, forged requests; and the headers of every answer."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import logging
import math
import re
import socket
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler

from cellwatt.door.tries import Guard
from cellwatt.errors import CellwattError, OutletError
from cellwatt.host import is_address
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.sessions import Hash, Sessions, new_token, parse
from cellwatt.outlets.zenoh.messages import encode_json

log = logging.getLogger(__name__)

CSRF: Final = "X-CSRF-Token"
LARGEST_BODY: Final = 16 * 1024
"""Largest body, bytes, of a request."""
WAITING: Final = 16
"""Largest number of logins that are checked or wait; two are checked at a time."""
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "font-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Cache-Control": "no-store",
}
_HOST: Final = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\[\]:@/\\?#\s]+)(?::\d{1,5})?")
_LOCAL: Final = frozenset(("localhost", "127.0.0.1", "::1"))
_UNLOCKED: Final = ("/api/site", "/api/login")
_YEAR: Final = 365 * 86400


@dataclass(frozen=True, slots=True)
class Visitor:
    """Sender of a request: ``name`` of the login, ``token`` of the browser; ``new``: the browser had no token."""

    name: str | None
    may_act: bool
    token: str
    new: bool


VISITOR: Final = web.RequestKey("visitor", Visitor)


def answer(data: object, status: int = HTTPStatus.OK) -> web.Response:
    """Data as JSON."""
    return web.Response(body=encode_json(data), status=status, content_type="application/json", charset="utf-8")


def refusal(status: int, text: str, **headers: str) -> web.Response:
    """An error answer, its text in one line."""
    plain = text.encode("utf-8", "replace").decode()  # text from a request may not be UTF-8
    made = answer({"error": " ".join(plain.split())}, status)
    made.headers.update(headers)
    return made


class Gate:
    """Checks requests by the settings of the page; ``names`` are further host names of the page."""

    def __init__(self, settings: PageSettings, sessions: Sessions, names: Iterable[str] = ()) -> None:
        self._settings = settings
        self.counts: Counter[str] = Counter()
        self._guard = Guard("page", self.counts)
        self.sessions = sessions
        self._hosts = _hosts(settings, names)
        self._hashes = {name: parse(user.password.get_secret_value()) for name, user in settings.users.items()}
        self._two = asyncio.Semaphore(2)
        self._waiting = 0
        self._saving = asyncio.Lock()

    @property
    def cookie(self) -> str:
        """Name of the cookie; it contains the port, as browsers share cookies between ports."""
        name = f"cellwatt-{self._settings.port}"
        return f"__Host-{name}" if self._settings.certificate is not None else name

    # every request --------------------------------------------------------------------------------

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Check a request, and convert each error to JSON."""
        try:
            return self._check(request) or await handler(request)
        except web.HTTPException as error:
            return refusal(error.status, error.text or error.reason, **_headers_of(error))
        except OutletError as error:
            return refusal(HTTPStatus.SERVICE_UNAVAILABLE, str(error))
        except CellwattError as error:
            return refusal(HTTPStatus.CONFLICT, str(error))
        except Exception:
            log.exception("%s %s cannot be answered", request.method, request.path)
            return refusal(HTTPStatus.INTERNAL_SERVER_ERROR, "this is a bug in cellwatt; see the log")

    async def prepare(self, request: web.Request, response: web.StreamResponse) -> None:
        """Add the headers to an answer before it is sent."""
        for name, value in HEADERS.items():
            response.headers.setdefault(name, value)
        response.headers["Server"] = "cellwatt"
        if self._settings.certificate is not None:
            response.headers["Strict-Transport-Security"] = f"max-age={_YEAR}"

    def _check(self, request: web.Request) -> web.Response | None:
        """The refusal of a request; ``None`` if it is allowed: then its visitor is stored in the request."""
        host = _host_of(request.host)
        if host not in self._hosts and (self._settings.local or not is_address(host)):
            text = f"this page is not known as {host:.100}; if it is yours, add it to names in the settings of the page"
            return refusal(HTTPStatus.MISDIRECTED_REQUEST, text)
        visitor = self._visitor(request)
        request[VISITOR] = visitor
        if request.method not in ("GET", "HEAD") and (text := self._forged(request, visitor)):
            return refusal(HTTPStatus.FORBIDDEN, text)
        locked = request.path.startswith("/api/") and request.path not in _UNLOCKED
        if locked and self._settings.users and visitor.name is None:
            return refusal(HTTPStatus.UNAUTHORIZED, "log in first")
        return None

    def _visitor(self, request: web.Request) -> Visitor:
        token = request.cookies.get(self.cookie, "")
        name = self.sessions.name_of(token) if token and self._settings.users else None
        fresh = not token
        return Visitor(name, self._settings.may_act(name), token or new_token(), fresh)

    def _forged(self, request: web.Request, visitor: Visitor) -> str:
        """Reason why a changing request may be forged by another site; ``""`` if it is not."""
        origin = request.headers.get("Origin")
        if origin is not None and request.host.lower() not in _netlocs(origin):
            return (
                f"the request comes from another site, {origin:.100}, and not from {request.host:.100}; "
                "a proxy in between must pass the header Host"
            )
        if request.headers.get("Sec-Fetch-Site", "same-origin") != "same-origin":
            return "the request comes from another site"
        shown = request.headers.get(CSRF, "")
        if visitor.new or not hmac.compare_digest(_encoded(shown), self.sessions.csrf(visitor.token).encode()):
            return f"the request lacks its {CSRF}: load the page again"
        return ""

    # logins ---------------------------------------------------------------------------------------

    async def log_in(self, request: web.Request, name: str, password: str) -> web.Response:
        """Check a name and password; the answer sets the cookie of a new login."""
        if not self._settings.users:
            return refusal(HTTPStatus.CONFLICT, "no login is needed: the page has no users")
        address = request.remote or ""
        wait = 1.0 if self._waiting >= WAITING else self._guard.begin(address, name)
        if wait:
            seconds = max(1, math.ceil(wait))
            text = f"too many tries: wait {seconds} s"
            return refusal(HTTPStatus.TOO_MANY_REQUESTS, text, **{"Retry-After": str(seconds)})
        if not await self._fits(name, password):
            self._guard.fail(address, name)
            return refusal(HTTPStatus.UNAUTHORIZED, "wrong name or password")
        self._guard.succeed(address, name)
        self.sessions.end(request[VISITOR].token)
        made = answer({})
        self.set_cookie(made, self.sessions.begin(name))
        await self.save()
        return made

    async def log_out(self, request: web.Request) -> web.Response:
        """End the login of a browser."""
        self.sessions.end(request[VISITOR].token)
        made = answer({})
        self.set_cookie(made, new_token())
        await self.save()
        return made

    def set_cookie(self, response: web.Response, token: str) -> None:
        """Set the cookie with a browser's token."""
        secure = self._settings.certificate is not None
        response.set_cookie(
            self.cookie, token, max_age=_YEAR, path="/", httponly=True, samesite="Strict", secure=secure
        )

    async def save(self) -> None:
        """Save logins to disk."""
        async with self._saving:
            await asyncio.to_thread(self.sessions.save)

    async def _fits(self, name: str, password: str) -> bool:
        """True if the password is right; takes as long for an unknown name."""
        known = self._hashes.get(name)
        self._waiting += 1
        try:
            async with self._two:
                fits = await asyncio.to_thread((known or self._nobody()).fits, password)
        finally:
            self._waiting -= 1
        return fits and known is not None

    def _nobody(self) -> Hash:
        """A hash that no password matches, as costly as the hashes of users."""
        like = next(iter(self._hashes.values()))
        return Hash(like.n, like.r, like.p, like.salt, b"")


def proof_of(settings: PageSettings, name: str) -> str | None:
    """Digest of a user's password hash, stored in a login; ``None`` for an unknown user."""
    user = settings.users.get(name)
    return None if user is None else hashlib.sha256(user.password.get_secret_value().encode()).hexdigest()


def _hosts(settings: PageSettings, names: Iterable[str]) -> frozenset[str]:
    known = {settings.host, *settings.names, *names}
    if not settings.local:
        known.add(socket.gethostname())
    return frozenset(name.lower() for name in known) | _LOCAL


def _host_of(host: str) -> str:
    """A Host header without its port and brackets; ``""`` if it is malformed."""
    found = _HOST.fullmatch(host)
    return found[1].strip("[]").rstrip(".").lower() if found else ""


def _netlocs(origin: str) -> tuple[str, ...]:
    """Host and port of an origin, also with the port that its scheme implies; empty if it is malformed."""
    try:
        parts = urlsplit(origin.lower())
    except ValueError:
        return ()
    return parts.netloc, f"{parts.netloc}:{443 if parts.scheme == 'https' else 80}"


def _encoded(header: str) -> bytes:
    """The bytes of a header, which may not be UTF-8."""
    return header.encode("utf-8", "surrogateescape")


def _headers_of(error: web.HTTPException) -> dict[str, str]:
    return {name: error.headers[name] for name in ("Allow", "Retry-After") if name in error.headers}
