"""Settings of the MQTT outlet."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Final, Literal, Self
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, PositiveInt, SecretStr, field_validator
from pydantic import model_validator as model_check

from cellwatt.files import unreadable
from cellwatt.host import LAST_PORT, check_host, stays_here
from cellwatt.outlet import OutletSettings, both_or_neither, refusal
from cellwatt.outlets.selection import Selection
from cellwatt.quantity import Hertz, Seconds
from cellwatt.section import Section

LOCAL: Final = "mqtt://127.0.0.1:1883"
_BROKER = re.compile(r"(mqtts?)://(\[[0-9A-Fa-f:.%]+\]|[^\[\]:/@]+)(?::(\d{1,5}))?/?")
_LONGEST_KEEP_ALIVE: Final = 65535.0
_RESERVED = re.compile(r"[+/#\x00-\x1f\x7f]")


def _address(broker: str) -> str:
    found = _BROKER.fullmatch(broker)
    if found is None or not 0 < int(found[3] or 1) <= LAST_PORT:
        raise ValueError(f"expected mqtt://host:port or mqtts://host:port, like {LOCAL}; user and password apart")
    check_host(found[2].strip("[]"))
    return broker


def _plain(name: str) -> str:
    if not name or _RESERVED.search(name):
        raise ValueError(f"{name!r} is not a Sparkplug ID: expected at least one character, without + / #")
    return name


_Broker = Annotated[str, AfterValidator(_address)]
_Id = Annotated[str, AfterValidator(_plain)]


class SparkplugSettings(Section):
    """Names of the cell in a Sparkplug infrastructure."""

    group: _Id | None = None
    """Group ID; default: the site's name."""
    node: _Id | None = None
    """Edge Node ID; default: the cell's name. Each source of the cell is a device of this node."""
    primary_host: _Id | None = None
    """Host ID of the application that must be online before anything is sent; rows that it misses are back-filled."""


class MqttSettings(OutletSettings, Selection):
    """Publication over MQTT 5."""

    broker: _Broker = LOCAL
    """Address of the broker: ``mqtt://host:1883`` on this PC, or ``mqtts://host:8883`` (TLS) anywhere."""
    format: Literal["json", "sparkplug"] = "json"
    """``json``: topics ``cellwatt/SITE/CELL/…`` for any consumer; ``sparkplug``: Sparkplug B for SCADA hosts."""
    ca: Path | None = None
    """Authority (PEM) that signed the broker's certificate; default: the authorities that this PC trusts."""
    certificate: Path | None = None
    """The daemon's own certificate (PEM), for a broker that requires one."""
    key: Path | None = None
    """Private key of ``certificate``."""
    user: str | None = None
    """User name for the broker."""
    password: SecretStr | None = None
    """Password of the user; write ``${NAME}`` and set it in the environment."""
    client: str | None = None
    """Client ID; default: made of site, cell and the outlet's name."""
    keep_alive: Seconds = 30.0
    """Silence after which the connection is tested; after 1.5 times this, the broker publishes the daemon's will."""
    retain: bool = False
    """JSON: the broker retains the last row for later subscribers."""
    qos: Annotated[int, Field(ge=0, le=2)] = 1
    """JSON: quality of service of all messages except health, which has 0; Sparkplug prescribes its own."""
    sparkplug: SparkplugSettings = SparkplugSettings()
    """Names and primary host for ``format: sparkplug``."""
    health: Seconds = 10.0
    """Time between two messages of health while the state is unchanged."""
    queue: PositiveInt = 4096
    """Most rows, and most results, that wait for the broker; beyond that, the oldest are dropped and counted. Rows that
    are recorded are not dropped but back-filled later."""
    backfill: Hertz = 100.0
    """Most back-filled rows per second, read from the record and sent beside the live ones."""
    open: bool = False
    """Allow data and password to pass unencrypted through the network."""

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
        if not self.open and self.opening:
            raise refusal(self, (("broker",), self.broker, f"{self.opening}; {_ADVICE}"))
        return self

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
        return self.broker.startswith("mqtts:")

    @property
    def opening(self) -> str:
        """How outsiders get access, as text; empty if they cannot."""
        if self.encrypted or stays_here(self.host):
            return ""
        return "no TLS: anyone on the network path can read data and password, and impersonate the cell"

    def warnings(self) -> tuple[str, ...]:
        """Access left open on purpose, and unreadable files."""
        ways = (f"broker: {self.broker}: {self.opening} (open: true)",) if self.opening else ()
        return (*ways, *unreadable({"ca": self.ca, "certificate": self.certificate, "key": self.key}))


_ADVICE: Final = "use mqtts://, or a broker on this PC, or set open: true"
