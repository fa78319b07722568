"""Servers that take messages in the place of real ones, and keep all that reaches them."""

from __future__ import annotations

import asyncio
import json
import ssl
import warnings
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from email import message_from_bytes
from email.message import EmailMessage
from email.policy import default
from typing import Any

from aiohttp import web
from aiosmtpd.smtp import SMTP, AuthResult, Envelope, LoginPassword, Session

from tests.daemon.outlets.historian.loopback import Loopback

Answer = Callable[[web.BaseRequest], Awaitable[web.StreamResponse]]


@dataclass
class Call:
    path: str
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Web(Loopback):
    """``answers`` are given in turn, statuses or functions; then 200."""

    calls: list[Call] = field(default_factory=list)
    answers: list[int | Answer] = field(default_factory=list)

    async def take(self, request: web.BaseRequest) -> web.StreamResponse:
        self.calls.append(Call(request.path, dict(request.headers), await request.read()))
        answer = self.answers.pop(0) if self.answers else 200
        return web.Response(status=answer) if isinstance(answer, int) else await answer(request)


def hook(server: Web, path: str = "", **more: Any) -> dict[str, Any]:
    """A recipient by a webhook of this server."""
    return {"webhook": {"url": f"{server.url}/{path}"}, **more}


def web_server(tls: ssl.SSLContext | None = None) -> AbstractAsyncContextManager[Web]:
    return Web().open(tls)


@dataclass
class Mailbox:
    """The SMTP server. ``rcpt`` and ``data`` are answers given in turn; ``hang`` mails are taken in silence."""

    mails: list[tuple[list[str], EmailMessage]] = field(default_factory=list)
    rcpt: dict[str, list[str]] = field(default_factory=dict)
    data: list[str] = field(default_factory=list)
    hang: int = 0
    encrypted: list[bool] = field(default_factory=list)
    login: str | None = None
    port: int = 0

    async def handle_RCPT(
        self, _server: SMTP, _session: Session, envelope: Envelope, address: str, _options: list[str]
    ) -> str:
        if answers := self.rcpt.get(address):
            return answers.pop(0)
        envelope.rcpt_tos.append(address)
        return "250 OK"

    async def handle_DATA(self, server: SMTP, session: Session, envelope: Envelope) -> str:
        if self.data:
            return self.data.pop(0)
        assert isinstance(envelope.content, bytes)
        mail = message_from_bytes(envelope.content, policy=default)
        assert isinstance(mail, EmailMessage)
        self.mails.append((list(envelope.rcpt_tos), mail))
        assert server.transport is not None
        self.encrypted.append(server.transport.get_extra_info("sslcontext") is not None)
        self.login = session.auth_data.login.decode() if session.auth_data is not None else None
        if self.hang:
            self.hang -= 1
            await asyncio.sleep(3600)
        return "250 OK"


def _accept(_server: SMTP, _session: Session, _envelope: Envelope, _mechanism: str, data: Any) -> AuthResult:
    assert isinstance(data, LoginPassword)
    return AuthResult(success=data.password == b"right-password", handled=False, auth_data=data)


@asynccontextmanager
async def mail_server(
    starttls: ssl.SSLContext | None = None, tls: ssl.SSLContext | None = None, login: bool = False
) -> AsyncIterator[Mailbox]:
    box = Mailbox()
    sessions: list[SMTP] = []

    def make() -> SMTP:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that logins are allowed in the clear, where TLS is around them
            session = SMTP(
                box,
                hostname="localhost",
                tls_context=starttls,
                require_starttls=starttls is not None,
                authenticator=_accept if login else None,
                auth_required=login,
                auth_require_tls=starttls is not None,
                loop=asyncio.get_running_loop(),
            )
        sessions.append(session)
        return session

    server = await asyncio.get_running_loop().create_server(make, "127.0.0.1", 0, ssl=tls)
    box.port = server.sockets[0].getsockname()[1]
    try:
        yield box
    finally:
        server.close()
        tasks = [task for session in sessions if (task := session._handler_coroutine) is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for session in sessions:
            if session.transport is not None:
                session.transport.close()
        await server.wait_closed()
