"""Settings of the cell over MQTT."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Final, Literal, Self
from urllib.parse import urlsplit

from pydantic import Field, PositiveInt, SecretStr, field_validator
from pydantic import model_validator as model_check

from cellwatt.files import unreadable
from cellwatt.host import LAST_PORT, check_host, stays_here
from cellwatt.outlet import OutletSettings, Section, both_or_neither, refusal
from cellwatt.outlets.selection import Selection
from cellwatt.quantity import Hertz, Seconds

LOCAL: Final = "mqtt://127.0.0.1:1883"
_BROKER = re.compile(r"(mqtts?)://(\[[0-9A-Fa-f:.%]+\]|[^\[\]:/@]+)(?::(\d{1,5}))?/?")
_LONGEST_KEEP_ALIVE: Final = 65535.0
_RESERVED = re.compile(r"[+/#\x00-\x1f\x7f]")


class SparkplugSettings(Section):
    """Place of the cell in a Sparkplug infrastructure."""

    group: str | None = None
    """Group ID; the site's name where absent."""
    node: str | None = None
    """Edge Node ID; the cell's name where absent. Each source of the cell is a device of this node."""
    primary_host: str | None = None
    """Host ID of the application that must be online before anything is sent; what it misses it gets later."""

    @field_validator("group", "node", "primary_host")
    @classmethod
    def _plain(cls, name: str | None) -> str | None:
        if name is not None and (not name or _RESERVED.search(name)):
            raise ValueError(f"{name!r} is no Sparkplug ID: it has at least one character, and none of + / #")
        return name


class MqttSettings(OutletSettings, Selection):
    """The cell over MQTT 5."""

    broker: str = LOCAL
    """Broker, as ``mqtt://host:1883`` on this PC, or ``mqtts://host:8883`` (TLS) anywhere."""
    fallbacks: tuple[str, ...] = ()
    """Other brokers of the same plant, tried in turn when the connection to one fails; TLS, user and the rest are the
    same. What one of them took is not sent to another."""
    format: Literal["json", "sparkplug"] = "json"
    """``json``: topics ``cellwatt/SITE/CELL/…`` for any consumer; ``sparkplug``: Sparkplug B for SCADA hosts."""
    ca: Path | None = None
    """Authority (PEM) that signed the broker's certificate; where absent, those that this PC trusts."""
    certificate: Path | None = None
    """Our own certificate (PEM), for a broker that asks for one."""
    key: Path | None = None
    """Private key of ``certificate``."""
    user: str | None = None
    """Name that we give to the broker."""
    password: SecretStr | None = None
    """Its password; write ``${NAME}`` and set it in the environment."""
    client: str | None = None
    """Client ID; made of site, cell and the outlet's name where absent."""
    keep_alive: Seconds = 30.0
    """Silence after which the connection is tested; the broker publishes our last will after half as much again."""
    frame: Literal["row", "channels"] = "row"
    """JSON: a row as one message on ``frame``, or each channel on ``frame/CHANNEL``."""
    retain: bool = False
    """JSON: the broker keeps the last row for those who subscribe later."""
    qos: Annotated[int, Field(ge=0, le=2)] = 1
    """JSON: quality of service of all but health, which has 0; Sparkplug prescribes its own."""
    sparkplug: SparkplugSettings = SparkplugSettings()
    """Names and primary host where ``format`` is ``sparkplug``."""
    health: Seconds = 10.0
    """Time between two messages of health that say the same state."""
    queue: PositiveInt = 4096
    """Rows, and results, that may wait for the broker; beyond that the oldest are dropped and counted."""
    backfill: Hertz = 100.0
    """Rows a second that are sent at most of what the broker missed, from the record, beside the live ones."""
    open: bool = False
    """Let data and password pass in the clear through the network."""

    @field_validator("fallbacks")
    @classmethod
    def _addresses(cls, brokers: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(cls._address(broker) for broker in brokers)

    @field_validator("broker")
    @classmethod
    def _address(cls, broker: str) -> str:
        found = _BROKER.fullmatch(broker)
        if found is None or not 0 < int(found[3] or 1) <= LAST_PORT:
            raise ValueError(f"expected mqtt://host:port or mqtts://host:port, like {LOCAL}; user and password apart")
        check_host(found[2].strip("[]"))
        return broker

    @field_validator("keep_alive")
    @classmethod
    def _whole(cls, seconds: float) -> float:
        if not 1.0 <= seconds <= _LONGEST_KEEP_ALIVE:
            raise ValueError(f"expected 1 s to {_LONGEST_KEEP_ALIVE:g} s")
        return seconds

    @model_check(mode="after")
    def _accepted(self) -> Self:
        both_or_neither(certificate=self.certificate, key=self.key)
        if self.password is not None and self.user is None:
            raise ValueError("a password needs a user")
        if not self.encrypted and (self.ca or self.certificate):
            raise ValueError("ca, certificate and key need a broker that begins with mqtts://")
        if any(_encrypted(broker) != self.encrypted for broker in self.fallbacks):
            raise ValueError("broker and fallbacks: all mqtts://, or all mqtt://")
        if not self.open and self.opening:
            where = "broker" if _reaches_out(self.broker) else "fallbacks"
            raise refusal(self, ((where,), getattr(self, where), f"{self.opening}; {_ADVICE}"))
        return self

    def at(self, turn: int) -> MqttSettings:
        """The same with the broker whose turn it is, from 0 on, and again from the first after the last."""
        brokers = (self.broker, *self.fallbacks)
        return self.model_copy(update={"broker": brokers[turn % len(brokers)]})

    @property
    def host(self) -> str:
        """Host name or address of the broker."""
        return urlsplit(self.broker).hostname or ""

    @property
    def port(self) -> int:
        """Port of the broker."""
        return urlsplit(self.broker).port or (8883 if self.encrypted else 1883)

    @property
    def encrypted(self) -> bool:
        """True if the connection is TLS."""
        return _encrypted(self.broker)

    @property
    def opening(self) -> str:
        """How strangers get in, in words; empty if they do not."""
        if not any(map(_reaches_out, (self.broker, *self.fallbacks))):
            return ""
        return "no TLS: whoever is on the way reads the data and the password, and can speak in the cell's name"

    def warnings(self) -> tuple[str, ...]:
        """Access left open on purpose, and files that cannot be read."""
        ways = (f"broker: {self.broker}: {self.opening} (open: true)",) if self.opening else ()
        return (*ways, *unreadable({"ca": self.ca, "certificate": self.certificate, "key": self.key}))


_ADVICE: Final = "use mqtts://, or a broker on this PC, or set open: true"


def _encrypted(broker: str) -> bool:
    return broker.startswith("mqtts:")


def _reaches_out(broker: str) -> bool:
    return not _encrypted(broker) and not stays_here(urlsplit(broker).hostname or "")
