"""Options of the commands that connect to running cells over Zenoh, and the link that they define."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from cellwatt.commands import EXISTING
from cellwatt.config import CellConfig, load
from cellwatt.outlets.zenoh.link import TlsSettings
from cellwatt.outlets.zenoh.reach import client_of, link_to
from cellwatt.subscriber import LinkSettings

PEM: Final = EXISTING
_OPTIONS: Final = (
    click.argument("file", required=False, type=click.Path(path_type=Path)),
    click.option("--connect", metavar="ENDPOINT", help="Endpoint of the cell or its router, e.g. tcp/192.0.2.1:7447."),
    click.option("--site", help="Site of the cell (with --connect)."),
    click.option("--cell", help="Name of the cell (with --connect)."),
    click.option("--ca", type=PEM, help="Certificate of the authority that signed the cell's, for tls/ endpoints."),
    click.option("--certificate", type=PEM, help="Your own certificate, if the cell requires one (with --ca, --key)."),
    click.option("--key", type=PEM, help="Private key of --certificate."),
    click.option("--verify", type=PEM, help="Public key of the cell: discard messages that it has not signed."),
)


@dataclass(frozen=True, slots=True)
class Where:
    """Options that name a cell, or a site with all of its cells."""

    file: Path | None
    connect: str | None
    site: str | None
    cell: str | None
    tls: TlsSettings | None
    verify: Path | None

    @property
    def whole_site(self) -> tuple[str, LinkSettings] | None:
        """Site and link if the options name all cells of a site. Raises ``click.UsageError`` if ``verify`` is set."""
        if self.file is None and self.connect and self.site and not self.cell:
            if self.verify is not None:
                raise click.UsageError("--verify is the key of one cell: give --cell, too")
            return self.site, _client(self.connect, self.tls)
        return None

    def target(self, config: CellConfig | None = None) -> tuple[str, str, LinkSettings]:
        """Site, name and link of the cell in ``config``, in FILE, or in --connect, --site and --cell."""
        if self.file is not None and (self.site or self.cell):
            raise click.UsageError("--site and --cell name the cell of --connect, not that of FILE")
        if config is None and self.file is not None:
            config = load(self.file)
        if config is not None:
            return config.site, config.cell, link_to(config, self.connect, "; or use --connect", self.tls)
        if not (self.connect and self.site and self.cell):
            raise click.UsageError("give a cell's FILE, or --connect, --site and --cell")
        return self.site, self.cell, _client(self.connect, self.tls)


def cell_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that name a cell and its link to a command; the command receives them as ``where``."""

    @wraps(command)
    def called(ca: Path | None, certificate: Path | None, key: Path | None, **more: Any) -> Any:
        about = {name: more.pop(name) for name in ("file", "connect", "site", "cell", "verify")}
        return command(where=Where(**about, tls=_tls_of(ca, certificate, key)), **more)

    for option in reversed(_OPTIONS):
        called = option(called)
    return called


def _tls_of(ca: Path | None, certificate: Path | None, key: Path | None) -> TlsSettings | None:
    """TLS settings from the command line. Raises ``click.UsageError`` if one of the files is missing."""
    if ca is None and certificate is None and key is None:
        return None
    if ca is None or (certificate is None) != (key is None):
        raise click.UsageError("give --ca, and --certificate and --key together if the cell requires them")
    return TlsSettings(root_ca=ca, certificate=certificate, key=key)


def _client(connect: str, tls: TlsSettings | None) -> LinkSettings:
    """The link to an endpoint. Raises ``click.UsageError`` if it needs certificates and none are given."""
    if connect.startswith(("tls/", "quic/")) and tls is None:
        raise click.UsageError(f"{connect} needs --ca FILE, and --certificate and --key if the cell requires them")
    return client_of((connect,), tls)
