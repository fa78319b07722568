"""Settings of the metrics, and who may read them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, PositiveInt, SecretStr, field_validator
from pydantic import model_validator as model_check

from cellwatt.door.settings import Listening
from cellwatt.outlets.metrics.catalogue import LABELS

LOCAL: Final = "127.0.0.1:9480"
_LABEL: Final = re.compile(r"(?!__)[A-Za-z_][A-Za-z0-9_]{0,63}")
_LONGEST: Final = 200
"""Characters of a constant label."""
_MOST_LABELS: Final = 16
_SHORT: Final = 16
"""Characters of a token below which it can be guessed: a right one is let in however many wrong ones came before."""


class MetricsSettings(Listening):
    """Metrics for Prometheus, and probes of the cell's health."""

    login = "a token"

    listen: str = LOCAL
    """Address and port; beyond this PC only with a certificate and a token."""
    certificate: Path | None = None
    """Certificate (PEM) with which metrics are served as https, with the authorities between, if there are any."""
    token: SecretStr | None = None
    """Token that a reader shows as ``Authorization: Bearer``."""
    labels: Mapping[str, str] = Field(default_factory=dict)
    """Labels on every metric, like ``site`` and ``cell``; leave them out where Prometheus' own file sets them."""
    channels: Annotated[tuple[str, ...], Field(min_length=1)] = ("*",)
    """Channels whose power is told, by name or pattern; only those in W count."""
    series: PositiveInt = 200
    """Most series of one metric; what is beyond is left out and counted."""
    open: bool = False
    """Let the network in without TLS or token: anybody there can then read what the cell does."""

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
    def _login(self) -> MetricsSettings:
        if self.token is not None and not self.token.get_secret_value():
            raise ValueError("token: it is empty")
        return self

    @property
    def asks(self) -> bool:
        """True if readers must show a token."""
        return self.token is not None

    def warnings(self) -> tuple[str, ...]:
        """See ``Listening.warnings``; also a token that can be guessed."""
        if self.token is None or len(self.token.get_secret_value()) >= _SHORT:
            return super().warnings()
        advice = f"fewer than {_SHORT} characters can be guessed; 'openssl rand -hex 16' makes enough"
        return (*super().warnings(), f"token: {advice}")
