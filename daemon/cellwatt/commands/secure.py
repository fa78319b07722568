"""``cellwatt secure``: certificates, access rules and signing keys of a site."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path

import click

from cellwatt.commands import EXIT_FAILED, FOLDER
from cellwatt.errors import ConfigError
from cellwatt.progress.terminal import show_table

try:
    from cellwatt.secure.access import Member, Role
    from cellwatt.secure.folder import Folder
except ImportError as error:
    raise ConfigError("cellwatt secure needs the extra 'secure': pip install 'cellwatt[secure]'") from error

SOON = timedelta(days=60)
"""Certificates that expire sooner are renewed if no names are given."""

_folder = click.option("--in", "path", default=Path(), type=FOLDER, help="Folder made by init (default: here).")


@click.group(short_help="Create certificates and access rules.")
def command() -> None:
    """Create certificates for cells and viewers, and rules for who may publish, query and subscribe.

    DIR contains the private key of your certificate authority: store it on a separate PC or USB stick. Copy to each
    member the folder with its name. docs/outlets/zenoh.md explains the steps.
    """


@command.command()
@click.argument("folder", metavar="DIR", type=FOLDER)
@click.option("--site", required=True, help="Site of the cells, as in their settings.")
def init(folder: Path, site: str) -> None:
    """Create a certificate authority for a site in DIR."""
    Folder.create(folder, site)
    click.echo(f"{folder}: authority of {site}. Keep {folder / 'private'} secret. Next, in {folder}:")
    click.echo("  cellwatt secure router NAME --host HOST    only if cells and viewers connect to a router")
    click.echo("  cellwatt secure cell NAME")
    click.echo("  cellwatt secure viewer NAME")


@command.command()
@click.argument("name")
@click.option("--host", "hosts", multiple=True, required=True, help="Host name or address; may be repeated.")
@_folder
def router(name: str, hosts: tuple[str, ...], path: Path) -> None:
    """Add the router that cells and viewers connect to (zenohd)."""
    _add(path, Member(name, "router", hosts))


@command.command()
@click.argument("name")
@click.option("--host", "hosts", multiple=True, help="Host name or address of the cell; may be repeated.")
@_folder
def cell(name: str, hosts: tuple[str, ...], path: Path) -> None:
    """Add a cell, which alone may publish and answer under its name.

    Without a router the cell itself listens for viewers, and needs --host.
    """
    _add(path, Member(name, "cell", hosts))


@command.command()
@click.argument("name")
@click.option("--cell", "cells", multiple=True, help="Cell that the viewer may see; may be repeated (default: all).")
@click.option("--live-only", is_flag=True, help="No queries: no settings, recordings or past alarms.")
@_folder
def viewer(name: str, cells: tuple[str, ...], live_only: bool, path: Path) -> None:
    """Add a viewer, which may subscribe and query, but not publish."""
    _add(path, Member(name, "viewer", (), cells, not live_only))


@command.command()
@click.argument("name")
@_folder
def remove(name: str, path: Path) -> None:
    """Revoke all rights of a member whose certificate has not expired."""
    folder = Folder.open(path)
    changed = folder.remove(name)
    click.echo(f"{name} loses all rights as soon as these members have their new folders:")
    _give_out(folder, changed)


@command.command()
@click.argument("names", metavar="[NAME]...", nargs=-1)
@_folder
def renew(names: tuple[str, ...], path: Path) -> None:
    """Renew the certificates of NAMEs, or all that expire in 60 days.

    The old certificates are valid until they expire: copy the new ones to the members before that.
    """
    folder = Folder.open(path)
    changed = folder.renew(names, SOON)
    if not changed:
        click.echo(f"no certificate expires within {SOON.days} days")
    _give_out(folder, changed)
    if folder.authority_due():
        click.echo(f"The authority expires on {folder.authority_ends():%Y-%m-%d}: make one with cellwatt secure init")


@command.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list.")
@_folder
def listing(as_json: bool, path: Path) -> None:
    """List members, rights and expiry dates. Exit code 1 if a certificate has expired."""
    folder = Folder.open(path)
    now = datetime.now(UTC)
    ends = {name: folder.end_of(name) for name in folder.members}
    if as_json:
        known = [{**asdict(m), "ends": ends[m.name].isoformat()} for m in folder.members.values()]
        authority = {"name": "authority", "role": "authority", "ends": folder.authority_ends().isoformat()}
        click.echo(json.dumps([*known, authority]))
    rows: list[tuple[str, ...]] = [
        (m.name, m.role, _may(m), ", ".join(m.hosts), _until(ends[m.name], now)) for m in folder.members.values()
    ]
    rows.append(("authority", "", f"signs for {folder.site}", "", _until(folder.authority_ends(), now)))
    if not as_json:
        show_table(("name", "role", "may", "hosts", "ends"), rows)
    if any(end < now for end in (*ends.values(), folder.authority_ends())):
        sys.exit(EXIT_FAILED)


def _add(path: Path, member: Member) -> None:
    folder = Folder.open(path)
    changed = folder.add(member)
    click.echo(f"{member.name}: {_may(member)}, until {folder.end_of(member.name):%Y-%m-%d}")
    settings = path / member.name / ("zenohd.json5" if member.role == "router" else "zenoh.yaml")
    click.echo(_USE[member.role].format(settings=settings, name=member.name))
    _give_out(folder, [name for name in changed if name != member.name])


_USE: dict[Role, str] = {
    "router": "Copy the folder {name} to the router; run beside the folder: zenohd --config {name}/zenohd.json5",
    "cell": "Copy the folder {name} beside the cell's settings file, and add {settings} to that file.",
    "viewer": "Copy the folder {name} to the viewer; its link settings are in {settings}.",
}


_THEN: dict[Role, str] = {
    "router": "restart zenohd",
    "cell": "update its zenoh section from zenoh.yaml: cellwatt check, then reload (SIGHUP)",
    "viewer": "restart its link",
}


def _give_out(folder: Folder, changed: Sequence[str]) -> None:
    for name in changed:
        click.echo(f"  copy the folder {name} again; {_THEN[folder.members[name].role]}")


def _may(member: Member) -> str:
    if member.role == "router":
        return "relays"
    if member.role == "cell":
        return f"publishes and answers as {member.name}"
    return f"sees{' and asks' if member.asks else ''} {', '.join(member.cells) or 'all cells'}"


def _until(end: datetime, now: datetime) -> str:
    return f"{end:%Y-%m-%d}, " + ("HAS ENDED" if end < now else f"{(end - now).days} days")
