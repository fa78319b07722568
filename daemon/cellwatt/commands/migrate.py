"""``cellwatt migrate``: brings a settings file of an older cellwatt up to date."""

from __future__ import annotations

import contextlib
import difflib
import os
from pathlib import Path

import click

from cellwatt.config.document import Document, parse, read
from cellwatt.config.loading import load_document
from cellwatt.config.versions import KEY, NEWEST, migrated, stated
from cellwatt.errors import CellwattError, ConfigError, why


@click.command(short_help="Bring a settings file to the newest version.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--write", is_flag=True, help="Change FILE, too; the old one is kept as FILE.old.")
def command(file: Path, write: bool) -> None:
    """Show what brings the settings of FILE to the newest version, as a unified diff; comments and order stay.

    A file that states no version is taken as one of cellwatt 0.1.0. Ends with exit code 2 if the result still has
    mistakes, which are told.
    """
    document = read(file, os.environ)
    new = parse(file, migrated(document, stated(document) if KEY in document.value else 0), os.environ)
    if new.text == document.text:
        click.echo(f"{file}: version {NEWEST} is the newest, nothing to change")
    before, after = (_shown(d).splitlines(keepends=True) for d in (document, new))
    click.echo("".join(difflib.unified_diff(before, after, str(file), f"{file} (version {NEWEST})")), nl=False)
    if write and new.text != document.text:
        old = file.with_name(f"{file.name}.old")
        try:
            _replace(file, new.text, old)
        except OSError as error:
            raise CellwattError(f"{file} is left as it was: {why(error)}") from error
        click.echo(f"written; the settings of before are in {old}")
    load_document(new)


def _shown(document: Document) -> str:
    """Text without secrets, of settings that may be wrong."""
    with contextlib.suppress(ConfigError):
        load_document(document)
    return document.public_text


def _replace(file: Path, text: str, old: Path) -> None:
    """Write the new text under the file's name and rights at once; the old file gets another name."""
    status = file.stat()
    new = file.with_name(f".{file.name}.new")
    new.write_text(text, encoding="utf-8")
    try:
        new.chmod(status.st_mode & 0o7777)
        os.chown(new, status.st_uid, status.st_gid)
        old.unlink(missing_ok=True)
        os.link(file, old)
        new.replace(file)
    finally:
        new.unlink(missing_ok=True)
