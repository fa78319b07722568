"""Settings of the recipients of alarms."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, Self
from urllib.parse import SplitResult

from pydantic import AfterValidator, Field, PositiveInt, SecretStr, field_validator
from pydantic import model_validator as model_check

from cellwatt.files import unreadable
from cellwatt.host import LAST_PORT, Host, check_clear, in_the_clear, stays_here, web_address
from cellwatt.outlet import OutletSettings, both_or_neither
from cellwatt.outlets.notify.quiet import QuietSettings, Zone
from cellwatt.quantity import Seconds
from cellwatt.results import Severity
from cellwatt.section import Section

CHANNELS: Final = ("mail", "webhook", "ntfy", "home_assistant")
_ADDRESS: Final = re.compile(r"[^\s@<>,;\"\\()\[\]]+@[^\s@<>,;\"\\()\[\]]+")
_PORTS: Final = {"starttls": 587, "tls": 465, "none": 25}


def _address(text: str) -> str:
    if not _ADDRESS.fullmatch(text) or not text.isascii():
        raise ValueError(f"found {text!r:.120}, expected a mail address like shift@plant.example")
    return text


Address = Annotated[str, AfterValidator(_address)]
"""A mail address without a name in front."""


def _parts(url: str) -> SplitResult:
    return web_address(url, "https://plant.example/alarms")


def _shown(url: str) -> str:
    """A web address as it may be shown: without its path, which may contain a secret."""
    parts = _parts(url)
    return f"{parts.scheme}://{parts.netloc}"


class MailSettings(Section):
    """Mail through an SMTP relay."""

    host: Host
    """Mail server."""
    port: int | None = Field(default=None, ge=1, le=LAST_PORT)
    """Port of the mail server; default: 587, with ``tls: tls`` 465, with ``tls: none`` 25."""
    tls: Literal["starttls", "tls", "none"] = "starttls"
    """``starttls``: encrypted after the greeting, else nothing is sent; ``tls``: encrypted from the start; ``none``:
    only for a server on this PC."""
    ca: Path | None = None
    """Certificate authority (PEM) to trust instead of those of the system."""
    user: str | None = None
    """User to log in as."""
    password: SecretStr | None = None
    """Password of the user."""
    sender: Address = Field(alias="from")
    """Sender address."""
    to: tuple[Address, ...] = Field(min_length=1)
    """Addresses of the recipients."""

    @model_check(mode="after")
    def _closed(self) -> MailSettings:
        if self.tls == "none" and not stays_here(self.host):
            raise ValueError(f"tls: none is only for a server on this PC, not for {self.host}: use starttls or tls")
        both_or_neither(user=self.user, password=self.password)
        return self

    @property
    def at(self) -> int:
        """Effective port."""
        return self.port or _PORTS[self.tls]


class _Web(ABC, Section):
    ca: Path | None = None
    """Certificate authority (PEM) to trust instead of those of the system."""
    open: bool = False
    """Allow http without TLS to other PCs: anyone on the network path can read everything."""

    @property
    @abstractmethod
    def address(self) -> str:
        """Address that is called."""

    @model_check(mode="after")
    def _reachable(self) -> Self:
        _parts(self.address)
        check_clear(self.address, allowed=self.open)
        return self


class WebhookSettings(_Web):
    """A POST with JSON to your web address."""

    url: SecretStr
    """Address; treated as a secret, because many services put a token into it."""
    secret: SecretStr | None = Field(default=None, min_length=1)
    """Key of the signature: any text, or ``whsec_`` and base64; without it, requests are not signed."""

    @property
    def address(self) -> str:
        """Address that is called."""
        return self.url.get_secret_value()


class NtfySettings(_Web):
    """A push message through an ntfy server."""

    url: str
    """Address of the server, like ``https://ntfy.plant.example``."""
    topic: SecretStr
    """Topic; treated as a secret, because anyone who knows it can read the messages of a server without tokens."""
    token: SecretStr | None = None
    """Access token."""

    @model_check(mode="after")
    def _closed(self) -> NtfySettings:
        if not re.fullmatch(r"[-_A-Za-z0-9]{1,64}", self.topic.get_secret_value()):
            raise ValueError("topic: expected 1 to 64 letters, digits, '-' and '_'")
        return self

    @property
    def address(self) -> str:
        """Address that is called."""
        return self.url


class HomeAssistantSettings(_Web):
    """A notification by one of Home Assistant's ``notify`` services."""

    url: str
    """Address of Home Assistant, like ``https://home.plant.example:8123``."""
    service: str = Field(pattern=r"^[a-z0-9_]+$")
    """Name of the service behind ``notify.``, like ``mobile_app_shift``."""
    token: SecretStr
    """Long-lived access token."""

    @property
    def address(self) -> str:
        """Address that is called."""
        return f"{self.url.rstrip('/')}/api/services/notify/{self.service}"


Web = WebhookSettings | NtfySettings | HomeAssistantSettings
Channel = MailSettings | Web


class RecipientSettings(Section):
    """One recipient: one of ``mail``, ``webhook``, ``ntfy``, ``home_assistant``, and which alarms are sent to it."""

    mail: MailSettings | None = None
    """Send mail."""
    webhook: WebhookSettings | None = None
    """Post JSON to an address."""
    ntfy: NtfySettings | None = None
    """Push with ntfy."""
    home_assistant: HomeAssistantSettings | None = None
    """Notify with Home Assistant."""
    severity: Severity = "warning"
    """Least severity: info, warning or error."""
    kinds: tuple[str, ...] = ("*",)
    """Kinds of alarms to send, with ``*`` for any text, like ``joint_*``."""
    group: Seconds = Field(default=30.0, ge=0)
    """Alarms within this time of the first are sent as one message; 0: each separately, unless others wait."""
    quiet: tuple[QuietSettings, ...] = ()
    """Quiet times."""
    repeat: Seconds | None = Field(default=None, ge=60)
    """Time after which an active alarm is sent again, until it is acknowledged; at least a minute."""
    resolved: bool = True
    """Also report the end of an alarm that was sent."""

    @model_check(mode="after")
    def _one(self) -> RecipientSettings:
        if sum(getattr(self, name) is not None for name in CHANNELS) != 1:
            raise ValueError(f"expected exactly one of {', '.join(CHANNELS)}")
        return self

    @property
    def kind(self) -> str:
        """Key of the channel that is set."""
        return next(name for name in CHANNELS if getattr(self, name) is not None)

    @property
    def channel(self) -> Channel:
        """The channel that is set."""
        found: Channel = getattr(self, self.kind)
        return found

    @property
    def place(self) -> str:
        """Kind and server of the channel, without its secrets."""
        channel = self.channel
        where = f"{channel.host}:{channel.at}" if isinstance(channel, MailSettings) else _shown(channel.address)
        return f"{self.kind} by {where}"

    @property
    def secrets(self) -> tuple[str, ...]:
        """Secrets of the channel, which no text may contain; the longest first."""
        values = (getattr(self.channel, name) for name in type(self.channel).model_fields)
        found = (value.get_secret_value() for value in values if isinstance(value, SecretStr))
        return tuple(sorted(filter(None, found), key=len, reverse=True))


class NotifySettings(OutletSettings):
    """Notifications of the cell's alarms to people."""

    to: Mapping[str, RecipientSettings] = Field(min_length=1)
    """Recipients, by a name of your choice."""
    page: str | None = None
    """Address of the page of the cell or plant, for a link in messages, like ``https://weld-3.plant.example:8480``."""
    zone: Zone | None = None
    """Time zone of the recipients, like Europe/Berlin; default: that of this PC."""
    timeout: Seconds = Field(default=30.0, gt=0)
    """Longest time of one attempt to send."""
    retry: Seconds = Field(default=5.0, gt=0)
    """Pause before the second attempt; it doubles with each further attempt, up to 10 min."""
    give_up: Seconds = Field(default=86400.0, gt=0)
    """Time after which a message that could not be sent is stored as undelivered."""
    queue: PositiveInt = 100
    """Most alarms that wait for a recipient; beyond that, the least severe are only counted in the message."""
    folder: Path | None = None
    """Folder of the delivery state; default: that of the record. Without a record, the state is in memory only."""

    @field_validator("to")
    @classmethod
    def _named(cls, to: Mapping[str, RecipientSettings]) -> Mapping[str, RecipientSettings]:
        for name in to:
            if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", name):
                raise ValueError(f"found {name!r:.80} as a name, expected letters, digits, '_', '-' and '.'")
        return to

    @field_validator("page")
    @classmethod
    def _page(cls, page: str | None) -> str | None:
        if page is not None and (_parts(page).query or _parts(page).fragment):
            raise ValueError("expected an address without ? and #")
        return page

    @property
    def each(self) -> dict[str, RecipientSettings]:
        """The recipients by name; each mail address apart, by name and address, so that none waits for another."""
        found: dict[str, RecipientSettings] = {}
        for name, to in self.to.items():
            if to.mail is None:
                found[name] = to
                continue
            for address in to.mail.to:
                mail = to.mail.model_copy(update={"to": (address,)})
                found[f"{name} {address}"] = to.model_copy(update={"mail": mail})
        return found

    def warnings(self) -> tuple[str, ...]:
        """Recipients without encryption, and certificate authorities that cannot be read."""
        return tuple(f"to.{name}: {text}" for name, to in self.to.items() for text in _doubts(to.channel))


def recipient_of(key: str) -> str:
    """Name of the recipient of a key of ``NotifySettings.each``."""
    return key.partition(" ")[0]


def _doubts(channel: Channel) -> Iterator[str]:
    if not isinstance(channel, MailSettings) and in_the_clear(channel.address):
        yield f"{_shown(channel.address)}: alarms and tokens are sent unencrypted (open: true)"
    yield from unreadable({"ca": channel.ca})
