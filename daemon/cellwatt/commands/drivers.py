"""``cellwatt drivers``: lists installed drivers, stages and outlets, and their settings."""

from __future__ import annotations

import inspect
import json
import sys
from dataclasses import asdict
from typing import Any

import click

from cellwatt.channel import Channel, Stream
from cellwatt.commands import EXIT_USAGE
from cellwatt.config.installed import Installed, installed
from cellwatt.config.reference import Field, reference
from cellwatt.config.wording import did_you_mean
from cellwatt.progress.terminal import show_table
from cellwatt.runtime.assemble import typical_streams


@click.command(short_help="List drivers, stages and outlets, or the settings of one.")
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(name: str | None, as_json: bool) -> None:
    """List installed drivers, stages and outlets; with NAME, print the settings of that one."""
    parts = installed()
    if name is None:
        _list(parts, as_json)
        return
    chosen = [p for p in parts if p.name == name]
    if not chosen:
        hint = did_you_mean(name, [p.name for p in parts])
        raise click.UsageError(f"no driver, stage or outlet named {name!r}{hint}")
    if as_json:
        click.echo(json.dumps([_details(p) for p in chosen], indent=2, ensure_ascii=False))
    else:
        for part in chosen:
            _page(part)
    if any(p.found is None for p in chosen):
        sys.exit(EXIT_USAGE)


def _channel(channel: Channel) -> dict[str, str]:
    return {"name": channel.name, "unit": channel.unit, "kind": channel.kind, "method": channel.method}


def _list(parts: list[Installed], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps([_summary(p) for p in parts], indent=2, ensure_ascii=False))
        return
    rows = [(p.kind, p.name, f"{p.package} {p.version}".strip(), p.title) for p in parts]
    show_table(("kind", "name", "package", "what it is"), rows)


def _summary(part: Installed) -> dict[str, Any]:
    return {
        "kind": part.kind,
        "name": part.name,
        "package": part.package,
        "version": part.version,
        "title": part.title,
        "loads": part.found is not None,
    }


def _details(part: Installed) -> dict[str, Any]:
    return {
        **_summary(part),
        "about": _about(part),
        "writes": list(getattr(part.found, "writes", ())),
        "needs": list(getattr(part.found, "needs", ())),
        "settings": [asdict(f) for f in _fields(part)],
        "streams": [
            {"name": s.name, "rate": s.rate, "clock": s.clock, "channels": [_channel(c) for c in s.channels]}
            for s in typical_streams(part)
        ],
    }


def _page(part: Installed) -> None:
    click.echo(f"{part.name} ({part.kind}, {part.package} {part.version}): {part.title}")
    if part.found is None:
        return
    if about := _about(part):
        click.echo(f"\n{about}")
    fields = _fields(part)
    if fields:
        click.echo()
        rows = [(f.key, f.type, "(required)" if f.required else f.default, f.description) for f in fields]
        show_table(("key", "type", "default", "meaning"), rows)
    else:
        click.echo("\nIt has no settings.")
    if needs := getattr(part.found, "needs", ()):
        click.echo(f"\nNeeds stages of the kind: {', '.join(needs)}")
    if part.kind == "driver":
        click.echo("\nMay send to the device:")
        for line in getattr(part.found, "writes", ()) or ("nothing",):
            click.echo(f"  - {line}")
        _show_channels(part)
        click.echo(f"\nTry it without the device: cellwatt emulate {part.name}")


def _show_channels(part: Installed) -> None:
    streams = typical_streams(part)
    if not streams:
        click.echo("\nIts channels depend on its settings; cellwatt check FILE lists them.")
        return
    click.echo("\nChannels with the default settings:")
    rows = [(s.name, rate_of(s), c.name, c.unit, c.kind, c.method) for s in streams for c in s.channels]
    show_table(("stream", "rate", "channel", "unit", "kind", "in frames"), rows)


def rate_of(stream: Stream) -> str:
    """Declared rate of a stream, as text."""
    return f"{stream.rate:g} Hz" if stream.rate else "on change"


def _about(part: Installed) -> str:
    """Docstrings of the settings class and of the part's class."""
    texts = [inspect.cleandoc(c.__doc__) for c in (part.found, part.settings) if c is not None and c.__doc__]
    return "\n\n".join(dict.fromkeys(texts)).replace("``", "")


def _fields(part: Installed) -> list[Field]:
    return [] if part.settings is None else reference(part.settings)
