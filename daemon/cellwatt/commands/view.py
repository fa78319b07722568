"""``cellwatt view``: shows a running cell, or all cells of a site, in a browser."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from pydantic import ValidationError

from cellwatt.commands import EXISTING, FILE
from cellwatt.commands.cell_link import Where, cell_options
from cellwatt.commands.options import SECONDS
from cellwatt.config import CellConfig, load
from cellwatt.config.fields import anchored
from cellwatt.config.settings_file import read_settings
from cellwatt.errors import ConfigError
from cellwatt.files import write_file
from cellwatt.outlet import revealed
from cellwatt.outlets.page import PageSettings
from cellwatt.outlets.page.sessions import hash_of
from cellwatt.subscriber import LinkSettings


@click.command(short_help="Show a live cell, or a recording, in a browser.")
@cell_options
@click.option("--listen", metavar="HOST:PORT", help="Address of the page (default: 127.0.0.1:8480).")
@click.option(
    "--page",
    type=EXISTING,
    help="YAML file with the keys of a page: section, like users, certificate (default: that of FILE).",
)
@click.option("--arm", "arms", multiple=True, metavar="SOURCE=FILE", help="URDF or robot.yaml of a source; repeatable.")
@click.option("--foxglove", is_flag=True, help="Serve the Foxglove app instead of browsers.")
@click.option(
    "--foxglove-layout", "layout", type=FILE, help="Write the Foxglove app's layout for the cell of FILE, and exit."
)
@click.option("--hash-password", is_flag=True, help="Ask for a password and print its hash, for users.")
@click.option("--seconds", type=SECONDS, help="Run time, s (default: until Ctrl-C).")
def command(
    where: Where,
    listen: str | None,
    page: Path | None,
    arms: tuple[str, ...],
    foxglove: bool,
    layout: Path | None,
    hash_password: bool,
    seconds: float | None,
) -> None:
    """Serve a page with the live cell of FILE, or of --connect, --site and --cell; without --cell, all of the site.

    The page is read-only: alarms are acknowledged on the page that the cell itself serves (`page:` in its file). It
    draws recordings dropped on it, and runs explain on them if a simulation is dropped, too. Without any cell, it
    serves dropped recordings only.
    """
    if hash_password:
        click.echo(str(hash_of(click.prompt("Password", hide_input=True, confirmation_prompt=True, err=True))))
        return
    if foxglove and (page is not None or arms):
        raise click.UsageError("--page and --arm are for browsers, not for --foxglove")
    config = None if where.file is None else _loaded(where.file)
    if layout is not None:
        _write_layout(layout, config)
        return
    own = None if config is None or "page" not in config.outlets else config.outlets["page"].settings
    given = own if page is None else read_settings(page, PageSettings)
    values: dict[str, Any] = revealed(given) if isinstance(given, PageSettings) else {}
    if page is None:
        values.pop("listen", None)  # the cell's own page listens at that address
    else:
        values = anchored(PageSettings, values, page.absolute().parent)
    settings = _settings(values, listen, arms)
    if (plant := where.whole_site) is not None:
        if foxglove:
            raise click.UsageError("--foxglove shows one cell: give --cell, too")
        site, link = plant
        _run(settings, link, site, None, None, seconds)
    elif not (foxglove or where.file or where.connect or where.site or where.cell):
        _run(settings, None, "", None, None, seconds)
    else:
        site, cell, link = where.target(config)
        if not foxglove:
            _run(settings, link, site, cell, where.verify, seconds)
            return
        from cellwatt.outlets.foxglove import serve

        at: dict[str, Any] = {} if listen is None else {"host": settings.host, "port": settings.port}
        with contextlib.suppress(KeyboardInterrupt):
            serve(link, site, cell, seconds=seconds, verify=where.verify, tell=click.echo, **at)


def _loaded(file: Path) -> CellConfig:
    try:
        return load(file)
    except ConfigError:
        if file.suffix.lower() in (".yaml", ".yml", ""):
            raise
        message = f"{file} is no settings file: draw it with cellwatt plot, or drop it on the page of cellwatt view"
        raise ConfigError(message) from None


def _write_layout(out: Path, config: CellConfig | None) -> None:
    from cellwatt.outlets.foxglove.layout import layout_of, text_of

    if config is None:
        raise click.UsageError("--foxglove-layout is made from a cell's FILE")
    write_file(out, text_of(layout_of(config)))
    click.echo(f"wrote {out}: in the app, import it as a layout")


def _settings(values: dict[str, Any], listen: str | None, arms: Sequence[str]) -> PageSettings:
    shapes = dict(values.get("arms") or {})
    for arm in arms:
        source, separator, path = arm.partition("=")
        if not (source and separator and path):
            raise click.BadParameter(f"found {arm!r}, expected SOURCE=FILE", param_hint="--arm")
        shapes[source] = path
    try:
        return PageSettings.model_validate({**values, "arms": shapes, **({"listen": listen} if listen else {})})
    except ValidationError as error:
        problems = (f"{'.'.join(map(str, e['loc']))}: {e['msg'].removeprefix('Value error, ')}" for e in error.errors())
        raise ConfigError("; ".join(text.removeprefix(": ") for text in problems)) from None


def _run(
    settings: PageSettings,
    link: LinkSettings | None,
    site: str,
    cell: str | None,
    verify: Path | None,
    seconds: float | None,
) -> None:
    from cellwatt.outlets.page.serving import view

    for warning in settings.warnings():
        click.echo(f"warning: {warning}", err=True)

    async def until_stopped() -> None:
        here = asyncio.current_task()
        assert here is not None
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, here.cancel)
        await view(settings, link, site, cell, verify, seconds, click.echo)

    with contextlib.suppress(KeyboardInterrupt, asyncio.CancelledError):
        asyncio.run(until_stopped())
