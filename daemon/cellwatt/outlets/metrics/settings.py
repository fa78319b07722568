"""Settings of the metrics, and who may read them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, PositiveInt, SecretStr
from pydantic import model_validator as model_check

from cellwatt.door.settings import Listening

LOCAL: Final = "127.0.0.1:9480"
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
    channels: Annotated[tuple[str, ...], Field(min_length=1)] = ("*",)
    """Channels whose power is told, by name or pattern; only those in W count."""
    series: PositiveInt = 200
    """Most series of one metric; what is beyond is left out and counted."""
    open: bool = False
    """Let the network in without TLS or token: anybody there can then read what the cell does."""

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
