"""Settings of the metrics and their readers."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import Field, PositiveInt, SecretStr
from pydantic import model_validator as model_check

from cellwatt.door.settings import Listening

LOCAL: Final = "127.0.0.1:9480"
_SHORT: Final = 16
"""Fewest characters of a token that cannot be guessed: failed attempts never delay the correct token."""


class MetricsSettings(Listening):
    """Metrics for Prometheus."""

    login = "a token"

    listen: str = LOCAL
    """Address and port; an address that other PCs reach needs a certificate and a token."""
    token: SecretStr | None = None
    """Token that readers must send as ``Authorization: Bearer``."""
    channels: Annotated[tuple[str, ...], Field(min_length=1)] = ("*",)
    """Channels whose power is published, by name or pattern; only channels in W."""
    series: PositiveInt = 200
    """Most series of one metric; further series are omitted and counted."""
    open: bool = False
    """Allow access from the network without TLS or token: anyone there can read the metrics."""

    @model_check(mode="after")
    def _login(self) -> MetricsSettings:
        if self.token is not None and not self.token.get_secret_value():
            raise ValueError("token: it is empty")
        return self

    @property
    def asks(self) -> bool:
        """True if readers need a token."""
        return self.token is not None

    def warnings(self) -> tuple[str, ...]:
        """See ``Listening.warnings``; also warns of a token that can be guessed."""
        if self.token is None or len(self.token.get_secret_value()) >= _SHORT:
            return super().warnings()
        advice = f"fewer than {_SHORT} characters can be guessed; 'openssl rand -hex 16' makes enough"
        return (*super().warnings(), f"token: {advice}")
