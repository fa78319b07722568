"""``cellwatt notify``: sends a test message to the recipients of alarms."""

from __future__ import annotations

import asyncio
import json
import sys
import time
import uuid
from collections.abc import Mapping
from pathlib import Path

import click

from cellwatt.commands import EXIT_ERROR
from cellwatt.config import load
from cellwatt.errors import CellwattError, ConfigError
from cellwatt.outlets.notify.channels import Channel, cleaned
from cellwatt.outlets.notify.courier import channel_to
from cellwatt.outlets.notify.quiet import zone_of
from cellwatt.outlets.notify.rules import Notification
from cellwatt.outlets.notify.settings import NotifySettings, RecipientSettings, recipient_of
from cellwatt.outlets.notify.texts import About

PATIENCE = 8.0
"""Timeout, s, of each message; a shorter timeout in the settings takes precedence."""


@click.command(short_help="Send a test message to the recipients of alarms.")
@click.option("--test", is_flag=True, required=True, help="Send a test message to each recipient.")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("recipient", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object: a reason for each, null: sent.")
def command(test: bool, file: Path, recipient: str | None, as_json: bool) -> None:
    """Send a test message to the recipients of alarms in FILE, or to RECIPIENT alone.

    The daemon need not run. Prints "ok" or the reason of the failure for each recipient and mail address. Exit code 3
    if one of them cannot be reached.
    """
    config = load(file)
    outlet = config.outlets.get("notify")
    if outlet is None or not isinstance(outlet.settings, NotifySettings):
        raise ConfigError(f"{file}: no notify section: name the recipients with 'notify: {{to: …}}'")
    settings = outlet.settings
    if recipient is not None and recipient not in settings.to:
        raise ConfigError(f"{file}: notify.to: no recipient {recipient!r} (known: {', '.join(settings.to)})")
    about = About(config.site, config.cell, settings.page, zone_of(settings.zone))
    chosen = {key: to for key, to in settings.each.items() if recipient in (None, recipient_of(key))}
    answers = asyncio.run(_try_all(chosen, about, min(settings.timeout, PATIENCE)))
    for name, reason in () if as_json else answers.items():
        click.echo(f"{name} ({chosen[name].place}): {reason or 'ok'}")
    if as_json:
        click.echo(json.dumps(answers))
    if any(reason is not None for reason in answers.values()):
        sys.exit(EXIT_ERROR)


async def _try_all(to: Mapping[str, RecipientSettings], about: About, patience: float) -> dict[str, str | None]:
    """Send to all recipients concurrently; return the reason of each failure, or ``None``."""
    reasons = await asyncio.gather(*(_try(each, channel_to(each, about, patience)) for each in to.values()))
    return dict(zip(to, reasons, strict=True))


async def _try(to: RecipientSettings, channel: Channel) -> str | None:
    try:
        await channel.send(Notification(uuid.uuid4().hex, time.time_ns()))
    except CellwattError as error:
        return cleaned(str(error), to.secrets)
    return None
