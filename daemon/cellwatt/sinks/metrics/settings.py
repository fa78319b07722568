"""Settings of the metrics, and who may read them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final

from pydantic import ConfigDict, Field, PositiveInt, SecretStr, ValidationError, field_validator
from pydantic import model_validator as model_check
from pydantic_core import InitErrorDetails, PydanticCustomError

from cellwatt.files import WRITTEN, open_file
from cellwatt.host import check_host
from cellwatt.publish.exposure import stays_here
from cellwatt.sink import SinkSettings
from cellwatt.sinks.metrics.catalogue import LABELS

LOCAL: Final = "127.0.0.1:9480"
_LISTEN: Final = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\[\]:]+):(\d{1,5})")
_LABEL: Final = re.compile(r"(?!__)[A-Za-z_][A-Za-z0-9_]{0,63}")
_LAST_PORT: Final = 65535
_LONGEST: Final = 200
"""Characters of a constant label."""
_MOST_LABELS: Final = 16


class MetricsSettings(SinkSettings):
    """Metrics for Prometheus, and probes of the cell's health."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, hide_input_in_errors=True)

    listen: str = LOCAL
    """Address and port; beyond this PC only with a certificate and a token or password."""
    certificate: Path | None = None
    """Certificate (PEM) with which metrics are served as https, with the authorities between, if there are any."""
    key: Path | None = None
    """Private key of ``certificate``."""
    token: SecretStr | None = None
    """Token that a reader shows as ``Authorization: Bearer``."""
    user: str | None = None
    """Name of a reader that shows a password instead (basic authentication)."""
    password: SecretStr | None = None
    """Its password."""
    labels: Mapping[str, str] = Field(default_factory=dict)
    """Labels on every metric, like ``site`` and ``cell``; leave them out where Prometheus' own file sets them."""
    channels: Annotated[tuple[str, ...], Field(min_length=1)] = ("*",)
    """Channels whose power is told, by name or pattern; only those in W count."""
    series: PositiveInt = 200
    """Most series of one metric; what is beyond is left out and counted."""
    open: bool = False
    """Let the network in without TLS or token: anybody there can then read what the cell does."""

    @field_validator("listen")
    @classmethod
    def _address(cls, listen: str) -> str:
        found = _LISTEN.fullmatch(listen)
        if found is None or int(found[2]) > _LAST_PORT:
            raise ValueError(f"{listen!r} is not an address; expected host:port, like {LOCAL}")
        check_host(found[1].strip("[]"))
        return listen

    @field_validator("labels")
    @classmethod
    def _labelled(cls, labels: Mapping[str, str]) -> Mapping[str, str]:
        if len(labels) > _MOST_LABELS:
            raise ValueError(f"at most {_MOST_LABELS} labels, found {len(labels)}")
        for name, value in labels.items():
            if not _LABEL.fullmatch(name):
                raise ValueError(f"{name!r:.80} is not a label; expected letters, digits and '_', like line")
            if name in LABELS:
                raise ValueError(f"{name!r} is a label that metrics have already; choose another name")
            if len(value) > _LONGEST or not value.isprintable():
                raise ValueError(f"{name}: expected at most {_LONGEST} printable characters")
        return labels

    @model_check(mode="after")
    def _closed(self) -> MetricsSettings:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key are needed together")
        if (self.user is None) != (self.password is None):
            raise ValueError("user and password are needed together")
        if self.user is not None and ":" in self.user:
            raise ValueError("user: a name has no ':'")
        if any(secret is not None and not secret.get_secret_value() for secret in (self.token, self.password)):
            raise ValueError("a token or password is empty")
        if not self.open and (text := self.opening):
            advice = "use 127.0.0.1, or give certificate, key and token, or set open: true"
            kind = PydanticCustomError("value_error", "{error}", {"error": f"{text}; {advice}"})
            problem = InitErrorDetails(type=kind, loc=("listen",), input=self.listen)
            raise ValidationError.from_exception_data(type(self).__name__, [problem], hide_input=True)
        return self

    @property
    def host(self) -> str:
        """Host name or address to listen at."""
        return self.listen.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """Port to listen at; 0 for any that is free."""
        return int(self.listen.rpartition(":")[2])

    @property
    def asks(self) -> bool:
        """True if readers must show a token or password."""
        return self.token is not None or self.password is not None

    @property
    def opening(self) -> str:
        """Words for the way in that strangers have; empty if there is none."""
        lacks = (["TLS"] if self.certificate is None else []) + ([] if self.asks else ["a token"])
        if stays_here(self.host) or not lacks:
            return ""
        harm = "tokens pass in the clear" if self.asks else "whoever reaches it reads what the cell does"
        return f"open to the network without {' and '.join(lacks)}: {harm}"

    def warnings(self) -> tuple[str, ...]:
        """Access left open on purpose, and keys and certificates that are missing or expire soon."""
        ways = (f"listen: {self.listen}: {self.opening} (open: true)",) if self.opening else ()
        return (*ways, *self._unreadable(), *self._expiring())

    def _unreadable(self) -> Iterator[str]:
        for option, path in {"certificate": self.certificate, "key": self.key}.items():
            if path is not None:
                try:
                    open_file(path, WRITTEN).close()
                except OSError as error:
                    yield f"{option}: {path} cannot be read: {error.strerror}"

    def _expiring(self) -> Iterator[str]:
        if self.certificate is None:
            return
        from cellwatt.publish.link import LinkSettings, TlsSettings
        from cellwatt.secure import validity

        tls = TlsSettings(root_ca=self.certificate, certificate=self.certificate, key=self.key)
        for text in validity.warnings(LinkSettings.model_construct(tls=tls)):
            if not text.startswith("tls.root_ca"):
                yield text.removeprefix("tls.")
