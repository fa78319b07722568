"""Settings of the historian: InfluxDB and the lake."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, Field, PositiveInt, SecretStr
from pydantic import model_validator as model_check

from cellwatt.files import unreadable
from cellwatt.host import check_clear, in_the_clear, web_address
from cellwatt.outlet import OutletSettings, both_or_neither
from cellwatt.outlets.forward import Flow
from cellwatt.outlets.selection import Selection
from cellwatt.quantity import Seconds
from cellwatt.section import Certified

_NAME: Final = r"^[^\x00-\x1f\x7f\"\\]{1,200}$"


def _web(url: str) -> str:
    like = "https://influx.plant.example:8086"
    parts = web_address(url, like)
    if parts.query or parts.fragment:
        raise ValueError(f"expected an address like {like}")
    return url.rstrip("/")


_Web = Annotated[str, AfterValidator(_web)]


class InfluxSettings(Flow, Certified):
    """InfluxDB by line protocol over HTTP: ``database`` for version 1, ``org`` and ``bucket`` for 2."""

    url: _Web
    """Address of the server, like ``https://influx.plant.example:8086``."""
    database: str | None = Field(default=None, pattern=_NAME)
    """Database (version 1)."""
    policy: str | None = Field(default=None, pattern=_NAME)
    """Retention policy of the database; default: the database's default policy."""
    user: str | None = None
    """User (version 1)."""
    password: SecretStr | None = None
    """Password of the user."""
    org: str | None = Field(default=None, pattern=_NAME)
    """Organisation (version 2)."""
    bucket: str | None = Field(default=None, pattern=_NAME)
    """Bucket (version 2)."""
    token: SecretStr | None = None
    """Token with write access to the bucket."""
    ca: Path | None = None
    """Certificate authority (PEM) to trust instead of those of the system."""
    measurement: str = Field(default="cellwatt", pattern=r"^[A-Za-z][A-Za-z0-9_]{0,63}$")
    """Measurement of the rows; those of alarms, tasks and energies begin with it."""
    batch: PositiveInt = Field(default=1000, le=50_000)
    """Most lines in one request."""
    timeout: Seconds = Field(default=10.0, gt=0)
    """Longest time of one request."""
    open: bool = False
    """Allow http without TLS to other PCs: anyone on the network path can read everything, including the token."""

    @model_check(mode="after")
    def _whole(self) -> InfluxSettings:
        if (self.database is None) == (self.bucket is None):
            raise ValueError("expected one of database (version 1) and bucket (version 2)")
        if self.bucket is not None and (self.org is None or self.token is None):
            raise ValueError("bucket needs org and token")
        if self.database is None and (self.policy is not None or self.user is not None):
            raise ValueError("policy and user go with database")
        both_or_neither(user=self.user, password=self.password)
        if self.user is not None and ":" in self.user:
            raise ValueError("user: a name cannot contain ':'")
        check_clear(self.url, allowed=self.open)
        return self


class LakeSettings(Selection, Certified):
    """A lake of Parquet files, in a folder or in S3: ``frames/site=…/cell=…/day=…/``; also alarms, tasks, energies."""

    folder: str = Field(min_length=1)
    """Folder, or ``s3://BUCKET/PATH``."""
    every: Seconds = Field(default=600.0, gt=0)
    """Time between two files."""
    results: bool = True
    """Also write alarms, tasks and energies."""
    endpoint: _Web | None = None
    """Address of an S3-compatible store, like ``https://minio.plant.example:9000``; default: Amazon S3."""
    region: str | None = None
    """Region of the bucket."""
    access_key: SecretStr | None = None
    """Access key; default: from the AWS environment."""
    secret_key: SecretStr | None = None
    """Secret of the access key."""
    ca: Path | None = None
    """Certificate authority (PEM) to trust instead of those of the system."""
    open: bool = False
    """Allow an ``endpoint`` with http, without TLS, on another PC."""

    @model_check(mode="after")
    def _whole(self) -> LakeSettings:
        if self.dead_band:
            raise ValueError("dead_band: a lake has every row; Parquet packs what does not change")
        both_or_neither(access_key=self.access_key, secret_key=self.secret_key)
        if not self.remote and (self.endpoint is not None or self.access_key is not None or self.region is not None):
            raise ValueError("endpoint, region and keys go with a folder s3://…")
        if self.remote and not re.fullmatch(r"s3://[a-z0-9][a-z0-9.-]{1,62}(/[^\s]*)?", self.folder):
            raise ValueError(f"{self.folder!r:.120} is not an S3 path; expected s3://BUCKET/PATH")
        check_clear(self.endpoint or "", allowed=self.open)
        return self

    @property
    def remote(self) -> bool:
        """True if the lake is in S3."""
        return self.folder.startswith("s3://")


class HistorianSettings(OutletSettings):
    """History of the cell in InfluxDB, in a lake of Parquet files, or in both."""

    influx: InfluxSettings | None = None
    """Write to InfluxDB."""
    lake: LakeSettings | None = None
    """Write Parquet files."""

    @model_check(mode="after")
    def _any(self) -> HistorianSettings:
        if self.influx is None and self.lake is None:
            raise ValueError("expected influx, lake, or both")
        return self

    def warnings(self) -> tuple[str, ...]:
        """Unencrypted connections, and certificate authorities that cannot be read."""
        return tuple(self._doubts())

    def _doubts(self) -> Iterator[str]:
        if self.influx is not None and in_the_clear(self.influx.url):
            yield f"influx.url: {self.influx.url}: data and token are sent unencrypted (open: true)"
        if self.lake is not None and in_the_clear(self.lake.endpoint or ""):
            yield f"lake.endpoint: {self.lake.endpoint}: data are sent unencrypted (open: true)"
        sections = {"influx": self.influx, "lake": self.lake}
        yield from unreadable({f"{name}.ca": section.ca for name, section in sections.items() if section is not None})
