"""Provenance of a page: input files with their digests, version, command line and settings."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from cellwatt.report.blocks import Folded, Html, Table, joined
from cellwatt.version import __version__


@dataclass(frozen=True)
class Provenance:
    """Provenance of a page."""

    files: Mapping[str, str]
    """Path → SHA-256, hex."""
    command: str
    """Command line; empty if no command made the page."""
    settings: Mapping[str, str]
    """All options of the command, including defaults."""
    made: datetime = field(default_factory=lambda: datetime.now(UTC))

    @classmethod
    def here(cls, files: Iterable[Path] = ()) -> Provenance:
        """Provenance of the running command with its input ``files`` (folder: all files in it). Raises ``OSError``."""
        context = click.get_current_context(silent=True)
        digests = {str(file): _digest(file) for path in files for file in _within(path)}
        if context is None:
            return cls(digests, "", {})
        named = [p for p in context.command.params if p.name in context.params]
        settings = {str(p.name): _shown(context.params[str(p.name)]) for p in named}
        given = [p for p in named if context.get_parameter_source(str(p.name)) is ParameterSource.COMMANDLINE]
        words = [word for p in given for word in _words(p, context.params[str(p.name)])]
        return cls(digests, shlex.join([*context.command_path.split(), *words]), settings)

    def html(self) -> Html:
        """Its markup: one line, with the details folded."""
        command = Html(f"<p><code>{escape(self.command)}</code></p>") if self.command else ""
        files = Table("Files", ("File", "SHA-256"), [(name, digest) for name, digest in self.files.items()])
        settings = Table("Settings", ("Setting", "Value"), list(self.settings.items()))
        count = f"{len(self.files)} file{'s' * (len(self.files) != 1)}"
        blocks = [files] * bool(self.files) + [settings] * bool(self.settings)
        made, when = f"Made by cellwatt {__version__}", f"{self.made:%Y-%m-%d %H:%M} UTC"
        folded = [Folded(f"{made} from {count}, {when}", [command, *blocks])] if blocks else []
        return joined(folded or [f"{made}, {when}."])


def _within(path: Path) -> Iterator[Path]:
    """The file itself, or the files of a folder, sorted."""
    if path.is_dir():
        yield from (file for file in sorted(path.rglob("*")) if file.is_file() or not file.exists())
    elif path.exists():
        yield path


def _digest(path: Path) -> str:
    """SHA-256, hex; a recording may have been closed, and thereby renamed, or removed since it was read."""
    for name in (path, path.with_name(path.name.removesuffix(".part"))):
        try:
            with name.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except FileNotFoundError:
            continue
    return "removed meanwhile"


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "–"
    return "–" if value is None else "yes" if value is True else "no" if value is False else str(value)


def _words(parameter: click.Parameter, value: Any) -> Sequence[str]:
    """A parameter as words of a command line."""
    values = list(map(str, value)) if isinstance(value, tuple) else [str(value)]
    if isinstance(parameter, click.Argument):
        return values
    option = max(parameter.opts, key=len)
    return [option] if value is True else [word for each in values for word in (option, each)]
