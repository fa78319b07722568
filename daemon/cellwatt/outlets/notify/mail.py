"""Mail by SMTP."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Iterator, Sequence
from email.message import EmailMessage
from email.policy import SMTP as SMTP_POLICY
from email.utils import format_datetime

import aiosmtplib
from aiosmtplib import (
    SMTPAuthenticationError,
    SMTPException,
    SMTPRecipientsRefused,
    SMTPResponseException,
    SMTPTimeoutError,
)

from cellwatt.outlets.notify.rules import Notification
from cellwatt.outlets.notify.settings import MailSettings
from cellwatt.outlets.notify.texts import About, body, severity, subject, utc
from cellwatt.outlets.remote import NotNowError, RefusedError, trust, unreached

GOODBYE = 1.0
"""Longest time, s, to end the session with a server that has accepted the mail."""
_FOR_EVER = 500
"""Smallest SMTP code of a permanent refusal."""
_OURS = (530, 534, 535, 538)
"""Refusals of the sender, not of the message: the server requires a login, another one, or encryption."""


class Mail:
    """Sends each message as a mail to the one address of its settings."""

    def __init__(self, settings: MailSettings, about: About, timeout: float) -> None:
        self._settings, self._about, self._timeout = settings, about, timeout

    async def send(self, message: Notification) -> None:
        """See ``Channel.send``."""
        client = await self._client()
        try:
            async with asyncio.timeout(self._timeout):
                with self._converted(final=False):
                    await client.connect()
                with self._converted(final=True):
                    await _hand_over(client, self._settings.sender, self._settings.to, self._content(message))
            with contextlib.suppress(SMTPException, OSError):
                await client.quit(timeout=GOODBYE)
        except TimeoutError:
            raise NotNowError(f"no answer within {self._timeout:g} s") from None
        finally:
            client.close()

    async def _client(self) -> aiosmtplib.SMTP:
        settings = self._settings
        return aiosmtplib.SMTP(
            hostname=settings.host,
            port=settings.at,
            username=settings.user,
            password=None if settings.password is None else settings.password.get_secret_value(),
            local_hostname="".join(socket.gethostname().split()) or "localhost",  # no DNS query
            use_tls=settings.tls == "tls",
            start_tls=settings.tls == "starttls",
            tls_context=None if settings.tls == "none" else await asyncio.to_thread(trust, settings.ca),
            timeout=self._timeout,
        )

    @contextlib.contextmanager
    def _converted(self, *, final: bool) -> Iterator[None]:
        """Convert SMTP errors to ``NotNowError``; if ``final``, permanent refusals to ``RefusedError``."""
        try:
            yield
        except SMTPAuthenticationError as error:
            raise NotNowError(f"the login as {self._settings.user} is refused: {error.code} {error.message}") from None
        except SMTPTimeoutError as error:
            raise NotNowError(f"no answer: {error.message}") from None
        except SMTPResponseException as error:
            reason = f"{error.code} {error.message}"
            if error.code in _OURS:
                raise NotNowError(f"{reason}: does the server require user and password, or tls?") from None
            raise (RefusedError if final and error.code >= _FOR_EVER else NotNowError)(reason) from None
        except SMTPException as error:
            cause = error.__cause__
            if isinstance(cause, OSError) and not isinstance(cause, SMTPException):
                raise NotNowError(unreached(cause)) from None
            no_tls = "STARTTLS" in error.message and self._settings.tls == "starttls"
            hint = "; nothing is sent unencrypted" if no_tls else ""
            raise NotNowError(f"{error.message}{hint}") from None
        except OSError as error:
            raise NotNowError(unreached(error)) from None

    def _content(self, message: Notification) -> bytes:
        settings, about = self._settings, self._about
        mail = EmailMessage(policy=SMTP_POLICY)
        mail["From"] = settings.sender
        mail["To"] = ", ".join(settings.to)
        mail["Subject"] = subject(about, message)
        mail["Date"] = format_datetime(utc(message.made))
        mail["Message-ID"] = f"<{message.id}@{settings.sender.rpartition('@')[2]}>"
        mail["Auto-Submitted"] = "auto-generated"
        mail["X-Auto-Response-Suppress"] = "All"
        if severity(message) == "error":
            mail["Importance"] = "high"
        mail.set_content(body(about, message), cte="quoted-printable")
        return mail.as_bytes()


async def _hand_over(client: aiosmtplib.SMTP, sender: str, to: Sequence[str], content: bytes) -> None:
    try:
        await client.sendmail(sender, to, content)
    except SMTPRecipientsRefused as error:
        raise error.recipients[0] from None
