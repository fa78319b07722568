"""``cellwatt watch``: shows a cell as its subscribers see it."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, TextIO

import click
from rich.console import Console
from rich.live import Live

from cellwatt.commands.cell_link import Where, cell_options
from cellwatt.commands.numbers import SECONDS
from cellwatt.errors import OutletError
from cellwatt.live.as_json import line_of
from cellwatt.live.bulletin import Bulletin
from cellwatt.live.site import site as table_of
from cellwatt.live.site import summary
from cellwatt.live.state import LiveCell
from cellwatt.live.view import Look, whole
from cellwatt.outlets.zenoh.link import open_session
from cellwatt.outlets.zenoh.reach import await_cell, site_health
from cellwatt.subscriber import EVERYTHING, LinkSettings, Message, Subscriber

if TYPE_CHECKING:
    import zenoh

QUIET = ("interval", "task", "energy", "prediction", "alarm", "event", "health")
"""Topics for people; ``raw`` and ``frame`` are for programs."""
SHOWN = (*QUIET, "frame")
"""Topics that the view takes: what was measured is in the frames."""
PULSE = 1.0
"""Longest time, s, without a look at the clock."""
REDRAW = 0.25
"""s between two drawings of a cell."""
SITE = 2.0
"""s between two tables of a site."""


@click.command(short_help="Show a live cell in the terminal.")
@cell_options
@click.option("--topic", "topics", multiple=True, type=click.Choice(EVERYTHING), help="Only these; may be repeated.")
@click.option(
    "--json", "as_json", is_flag=True, help="One JSON line a message; blocks as first, count, time and power."
)
@click.option("--power", metavar="CHANNEL", help="Measured power to hold against a model's, e.g. board.supply.power.")
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="PATTERN",
    help="Show these channels, e.g. arm.*.current; repeatable.",
)
@click.option("--patience", type=SECONDS, default=5.0, show_default=True, help="How long to try to reach the cell, s.")
@click.option("--wait", is_flag=True, help="Wait for the cell as long as it takes.")
@click.option("--seconds", type=SECONDS, help="How long, once connected (default: until Ctrl-C).")
def command(
    where: Where,
    topics: tuple[str, ...],
    as_json: bool,
    channels: tuple[str, ...],
    power: str | None,
    patience: float,
    wait: bool,
    seconds: float | None,
) -> None:
    """Show the live cell of FILE, or the one behind --connect, --site and --cell; without --cell, all of the site.

    In a terminal it is one page, drawn anew until Ctrl-C. Elsewhere, and with --topic, it prints a line for each
    alarm, interval, task and change of a source, and every 10 s how the cell stands. Exit code 3 if the cell is not
    heard.
    """
    screen = not as_json and not topics and sys.stdin.isatty() and sys.stdout.isatty()
    if (plant := where.whole_site) is not None:
        site, link = plant
        with contextlib.suppress(KeyboardInterrupt), open_session(link, patience=patience) as session:
            if screen:
                _show_site(session, site, seconds)
            else:
                _print_site(session, site, as_json=as_json)
        return
    site, cell, link = where.target()
    want = topics or (SHOWN if screen else QUIET)
    with contextlib.suppress(KeyboardInterrupt):
        _await(link, site, cell, patience, wait=wait)
        with Subscriber(site, cell, link, want=want, verify=where.verify) as subscriber:
            messages = _messages(subscriber, seconds)
            if as_json:
                _print_json(messages)
            elif screen:
                _show(messages, Look(channels=channels, power=power, ascii=not _unicode(sys.stdout)))
            else:
                _print_lines(messages, standing="health" in want)


def _unicode(stream: TextIO) -> bool:
    """True if a stream takes the glyphs that are shown."""
    try:
        "█".encode(stream.encoding or "ascii")
    except UnicodeError:
        return False
    return True


def _print_site(session: zenoh.Session, site: str, *, as_json: bool) -> None:
    cells = site_health(session, site)
    if as_json:
        for name, health in cells.items():
            click.echo(json.dumps(summary(name, health)))
    else:
        look = Look(Console().width, ascii=not _unicode(sys.stdout))
        click.echo(look.page(table_of(cells, look)).plain)
    if not cells:
        raise OutletError(f"no cell of site {site} is heard")


def _show_site(session: zenoh.Session, site: str, seconds: float | None) -> None:
    """Show a table of the cells of a site, anew every two seconds until ``seconds`` have passed."""
    end = math.inf if seconds is None else time.monotonic() + seconds
    plain = not _unicode(sys.stdout)
    with Live(auto_refresh=False) as live:
        while time.monotonic() < end:
            look = Look(live.console.width, ascii=plain)
            live.update(look.page(table_of(site_health(session, site), look)), refresh=True)
            time.sleep(SITE)


def _await(link: LinkSettings, site: str, cell: str, patience: float, *, wait: bool) -> None:
    """Return once the cell is heard; with ``wait`` say each new reason why it is not, and go on."""
    said = ""
    while True:
        try:
            return await_cell(link, site, cell, patience)
        except OutletError as error:
            if not wait:
                raise
            if str(error) != said:
                said = str(error)
                click.echo(f"waiting: {said}", err=True)


def _messages(subscriber: Subscriber, seconds: float | None) -> Iterator[Message | None]:
    """Messages until ``seconds`` have passed, or for ever; ``None`` for each second without one."""
    end = math.inf if seconds is None else time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        try:
            yield subscriber.receive(min(PULSE, left))
        except TimeoutError:
            yield None


def _print_json(messages: Iterable[Message | None]) -> None:
    for message in messages:
        if message is not None:
            click.echo(json.dumps(line_of(message)))


def _print_lines(messages: Iterable[Message | None], *, standing: bool) -> None:
    """Print what changes; with ``standing`` how the cell stands, too, which its health tells."""
    bulletin = Bulletin()
    for message in messages:
        lines = bulletin.of(message) if message is not None else ()
        for line in (*lines, *(bulletin.stands(time.monotonic()) if standing else ())):
            click.echo(line)


def _show(messages: Iterable[Message | None], look: Look) -> None:
    """Draw the cell anew four times a second at most; what was drawn last stays on the screen."""
    cell, drawn = LiveCell(), -math.inf
    with Live(auto_refresh=False, vertical_overflow="crop") as live:

        def draw() -> None:
            width, height = live.console.size
            live.update(whole(cell, replace(look, width=width), height=height), refresh=True)

        for message in messages:
            if message is not None:
                cell.take(message)
            if time.monotonic() - drawn >= REDRAW:
                draw()
                drawn = time.monotonic()
        draw()
