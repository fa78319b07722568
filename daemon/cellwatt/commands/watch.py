"""``cellwatt watch``: shows a cell as its subscribers see it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import click
from rich.live import Live

from cellwatt.batch import Batch
from cellwatt.commands.live_power import LivePower, power_of_frames
from cellwatt.commands.live_view import LiveCell
from cellwatt.config import load
from cellwatt.frames import Frames
from cellwatt.publish.link import TlsSettings
from cellwatt.publish.reach import client_of, link_to
from cellwatt.subscriber import EVERYTHING, Gap, Health, LinkSettings, Message, Subscriber

QUIET = ("interval", "task", "energy", "prediction", "alarm", "event", "health")
"""Topics for people; ``raw`` and ``frame`` are for programs."""
SHOWN = (*QUIET, "frame")
"""Topics that the view takes: what was measured is in the frames."""
PEM = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@click.option("--connect", metavar="ENDPOINT", help="Where the cell or its router listens, e.g. tcp/192.0.2.1:7447.")
@click.option("--site", help="Site of the cell (with --connect).")
@click.option("--cell", help="Name of the cell (with --connect).")
@click.option("--ca", type=PEM, help="Authority that signed the cell's certificate: for tls/ endpoints.")
@click.option("--certificate", type=PEM, help="Your own certificate, where the cell asks for one (with --ca, --key).")
@click.option("--key", type=PEM, help="Its private key.")
@click.option("--verify", type=PEM, help="The cell's public key: leave out what it has not signed.")
@click.option("--topic", "topics", multiple=True, type=click.Choice(EVERYTHING), help="Only these; may be repeated.")
@click.option(
    "--json", "as_json", is_flag=True, help="One JSON line a message; blocks as first, count, time and power."
)
@click.option("--power", metavar="CHANNEL", help="Measured power to hold against a model's, e.g. board.supply.power.")
@click.option("--seconds", type=float, help="How long, once connected (default: until Ctrl-C).")
def command(
    file: Path | None,
    connect: str | None,
    site: str | None,
    cell: str | None,
    ca: Path | None,
    certificate: Path | None,
    key: Path | None,
    verify: Path | None,
    topics: tuple[str, ...],
    as_json: bool,
    power: str | None,
    seconds: float | None,
) -> None:
    """Show the live cell of FILE, or the one behind --connect, --site and --cell."""
    site, cell, link = _target(file, connect, site, cell, _tls(ca, certificate, key))
    want = topics or (QUIET if as_json else SHOWN)
    printing = _printing() if as_json else _showing(LiveCell(power=LivePower(power)))
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_watch(Subscriber(site, cell, link, want=want, verify=verify), seconds, printing))


def _tls(ca: Path | None, certificate: Path | None, key: Path | None) -> TlsSettings | None:
    if ca is None and certificate is None and key is None:
        return None
    if ca is None or (certificate is None) != (key is None):
        raise click.UsageError("give --ca, and --certificate and --key together where the cell asks for yours")
    return TlsSettings(root_ca=ca, certificate=certificate, key=key)


def _target(
    file: Path | None, connect: str | None, site: str | None, cell: str | None, tls: TlsSettings | None
) -> tuple[str, str, LinkSettings]:
    if file is not None:
        config = load(file)
        return config.site, config.cell, link_to(config, connect, "; or use --connect", tls)
    if not (connect and site and cell):
        raise click.UsageError("give a cell's FILE, or --connect, --site and --cell")
    if connect.startswith(("tls/", "quic/")) and tls is None:
        raise click.UsageError(f"{connect} needs --ca FILE, and --certificate and --key where the cell asks for yours")
    return site, cell, client_of(connect, tls)


async def _watch(
    subscriber: Subscriber,
    seconds: float | None,
    printing: contextlib.AbstractContextManager[Callable[[Message], None]],
) -> None:
    async with subscriber:
        with contextlib.suppress(TimeoutError), printing as show:
            async with asyncio.timeout(seconds):
                async for message in subscriber:
                    show(message)


@contextlib.contextmanager
def _printing() -> Iterator[Callable[[Message], None]]:
    def show(message: Message) -> None:
        click.echo(json.dumps(plain(message)))

    yield show


@contextlib.contextmanager
def _showing(view: LiveCell) -> Iterator[Callable[[Message], None]]:
    with Live(view.render(), refresh_per_second=8, screen=False) as live:

        def show(message: Message) -> None:
            view.add(*kind_and_body(message))
            live.update(view.render())

        yield show


def kind_and_body(message: Message) -> tuple[str, dict[str, Any]]:
    """Topic kind and content of a message, JSON-ready; blocks are summarised as count and time span.

    Measured power in frames is kept in full, to be compared with predictions.
    """
    kind = message.topic.split("/", 1)[0]
    content = message.content
    if isinstance(content, Batch | Frames):
        block = {"count": len(content), "start": int(content.time[0]), "end": int(content.time[-1])}
        return kind, block | (power_of_frames(content) if isinstance(content, Frames) else {})
    if isinstance(content, Health):
        return kind, dict(content.status)
    if isinstance(content, Gap):
        return "gap", asdict(content)
    assert is_dataclass(content) and not isinstance(content, type)
    return kind, asdict(content)


def plain(message: Message) -> dict[str, Any]:
    """Format a message as one JSON line, with the time of receipt, UTC ns."""
    kind, body = kind_and_body(message)
    return {
        "kind": kind,
        "topic": message.topic,
        "session": message.session,
        "sequence": message.sequence,
        "backfilled": message.backfilled,
        "received": time.time_ns(),
        "content": body,
    }
