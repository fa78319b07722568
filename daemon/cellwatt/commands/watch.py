"""``cellwatt watch``: prints the messages of a live cell, as its subscribers receive them."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Iterable, Iterator

import click

from cellwatt.commands.cell_link import Where, cell_options
from cellwatt.commands.options import SECONDS
from cellwatt.errors import OutletError
from cellwatt.live.bulletin import Bulletin, line_of
from cellwatt.live.site import line, summary
from cellwatt.outlets.zenoh.link import open_session
from cellwatt.outlets.zenoh.messages import encode_json
from cellwatt.outlets.zenoh.reach import await_cell, site_health
from cellwatt.subscriber import EVERYTHING, LinkSettings, Message, Subscriber

QUIET = ("interval", "task", "energy", "prediction", "alarm", "event", "health")
"""Default topics, to be read by people; ``raw`` and ``frame`` are for programs."""
PULSE = 1.0
"""Longest wait, s, for one message before the time is checked again."""


@click.command(short_help="Show a live cell in the terminal.")
@cell_options
@click.option("--topic", "topics", multiple=True, type=click.Choice(EVERYTHING), help="Only this topic; repeatable.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON line per message; blocks as count, times and power."
)
@click.option("--patience", type=SECONDS, default=5.0, show_default=True, help="How long to try to reach the cell, s.")
@click.option("--wait", is_flag=True, help="Wait until the cell answers.")
@click.option("--seconds", type=SECONDS, help="Run time once connected, s (default: until Ctrl-C).")
def command(
    where: Where,
    topics: tuple[str, ...],
    as_json: bool,
    patience: float,
    wait: bool,
    seconds: float | None,
) -> None:
    """Show the live cell of FILE, or of --connect, --site and --cell; without --cell, all of the site.

    Prints a line for each alarm, interval, task and change of a source, and the state of the cell every 10 s, until
    Ctrl-C; for a site, one line per cell, once. Exit code 3 if the cell does not answer.
    """
    if (plant := where.whole_site) is not None:
        with contextlib.suppress(KeyboardInterrupt):
            _print_site(*plant, patience, as_json=as_json)
        return
    site, cell, link = where.target()
    want = topics or QUIET
    with contextlib.suppress(KeyboardInterrupt):
        _await(link, site, cell, patience, wait=wait)
        with Subscriber(site, cell, link, want=want, verify=where.verify) as subscriber:
            messages = _messages(subscriber, seconds)
            if as_json:
                _print_json(messages)
            else:
                _print_lines(messages, standing="health" in want)


def _print_site(site: str, link: LinkSettings, patience: float, *, as_json: bool) -> None:
    """Print the state of each cell of a site. Raises ``OutletError`` if no cell answers."""
    with open_session(link, patience=patience) as session:
        cells = [summary(name, status) for name, status in site_health(session, site).items()]
    for figures in cells:
        click.echo(json.dumps(figures) if as_json else line(figures))
    if not cells:
        raise OutletError(f"no cell of site {site} is heard")


def _await(link: LinkSettings, site: str, cell: str, patience: float, *, wait: bool) -> None:
    """Return once the cell answers; with ``wait``, print each new reason for the failure and try again."""
    reason = ""
    while True:
        try:
            return await_cell(link, site, cell, patience)
        except OutletError as error:
            if not wait:
                raise
            if str(error) != reason:
                reason = str(error)
                click.echo(f"waiting: {reason}", err=True)


def _messages(subscriber: Subscriber, seconds: float | None) -> Iterator[Message | None]:
    """Yield messages for ``seconds``, or forever if None; yield ``None`` after each second without a message."""
    end = math.inf if seconds is None else time.monotonic() + seconds
    while (remaining := end - time.monotonic()) > 0:
        try:
            yield subscriber.receive(min(PULSE, remaining))
        except TimeoutError:
            yield None


def _print_json(messages: Iterable[Message | None]) -> None:
    for message in messages:
        if message is not None:
            click.echo(encode_json(line_of(message)))


def _print_lines(messages: Iterable[Message | None], *, standing: bool) -> None:
    """Print each change; with ``standing``, also the state of the cell from its health messages."""
    bulletin = Bulletin()
    for message in messages:
        lines = bulletin.of(message) if message is not None else ()
        for text in (*lines, *(bulletin.stands(time.monotonic()) if standing else ())):
            click.echo(text)
