"""A session with Robot Web Services: reads pages, one at a time."""

from __future__ import annotations

import asyncio
import ssl
from base64 import b64encode
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError, WrongDeviceError
from cellwatt.files import WRITTEN, check_file
from cellwatt_drivers.abb.rws import LARGEST, LOGOUT
from cellwatt_drivers.abb.settings import AbbSettings

if TYPE_CHECKING:
    import aiohttp


class Web:
    """Reads pages with GET in one session of the controller, whose cookie it reuses: sessions are limited."""

    def __init__(self, session: aiohttp.ClientSession, settings: AbbSettings, tls: ssl.SSLContext | bool) -> None:
        self._session = session
        self._settings = settings
        self._tls = tls

    async def get(self, path: str) -> bytes:
        """Read a page.

        Raises ``ConnectError`` (no answer), ``WrongDeviceError`` (another device or another RobotWare answers),
        ``DeviceError`` (user or password refused, or an error of the controller) and ``ProtocolError``.
        """
        import aiohttp

        url = self._settings.url + path
        try:
            async with self._session.get(url, ssl=self._tls, allow_redirects=False) as answer:
                status, page = answer.status, b""
                async for part in answer.content.iter_any():
                    page += part
                    if len(page) > LARGEST:
                        raise ProtocolError(f"{url}: a page of more than {LARGEST} bytes")
        except TimeoutError as error:
            raise ConnectError(f"{url}: no answer within {self._settings.timeout:g} s") from error
        except (aiohttp.ClientConnectionError, OSError) as error:
            raise ConnectError(f"{url} cannot be read: {_reason(error)}") from error
        except aiohttp.ClientError as error:
            raise ProtocolError(f"{url}: invalid HTTP: {_reason(error)}") from error
        return self._judge(url, status, page)

    def _judge(self, url: str, status: int, page: bytes) -> bytes:
        if status == 200:
            return page
        if status == 401:
            raise DeviceError(
                f"{url}: user {self._settings.user!r} or the password is refused; see user, password, robotware"
            )
        if status == 503:
            raise DeviceError(f"{url}: the controller has no free session; close other clients")
        if status in (301, 302, 404, 406):
            raise WrongDeviceError(
                f"{url}: HTTP {status}: not a controller with RobotWare {self._settings.robotware}; "
                "see robotware, tls, port"
            )
        raise DeviceError(f"{url}: the controller answers HTTP {status}")


@asynccontextmanager
async def session(settings: AbbSettings) -> AsyncIterator[Web]:
    """Open a session (nothing is sent before the first page) and log out at the end."""
    import aiohttp

    jar = aiohttp.CookieJar(unsafe=True)  # controllers have numeric addresses; by default the jar refuses their cookies
    timeout = aiohttp.ClientTimeout(total=settings.timeout)
    connector = aiohttp.TCPConnector(limit=1)
    middlewares: tuple[aiohttp.ClientMiddlewareType, ...] = ()
    headers, password = {}, settings.password.get_secret_value()
    if settings.robotware == 6:
        middlewares = (aiohttp.DigestAuthMiddleware(settings.user, password),)
    else:
        login = b64encode(f"{settings.user}:{password}".encode()).decode()
        headers = {"Accept": "application/xhtml+xml;v=2.0", "Authorization": f"Basic {login}"}
    async with aiohttp.ClientSession(
        connector=connector, timeout=timeout, cookie_jar=jar, headers=headers, middlewares=middlewares
    ) as opened:
        web = Web(opened, settings, await _tls(settings))
        try:
            yield web
        finally:
            if len(jar):
                with suppress(SourceError):
                    await web.get(LOGOUT)


async def _tls(settings: AbbSettings) -> ssl.SSLContext | bool:
    if not settings.encrypted or settings.certificate is None:
        return False
    try:
        return await asyncio.to_thread(_trusting, Path(settings.certificate))
    except (OSError, ssl.SSLError) as error:
        raise ConnectError(f"certificate {settings.certificate} cannot be read: {error}") from error


def _trusting(certificate: Path) -> ssl.SSLContext:
    check_file(certificate, WRITTEN)
    return ssl.create_default_context(cafile=certificate)


def _reason(error: BaseException) -> str:
    return str(error) or type(error).__name__
