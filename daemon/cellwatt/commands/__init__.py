"""The ``cellwatt`` command line. Each command is an entry point, loaded only when called."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
import traceback
from collections.abc import Mapping
from io import TextIOWrapper
from pathlib import Path
from typing import Final

import click
from click.shell_completion import CompletionItem

from cellwatt.errors import CellwattError, ConfigError
from cellwatt.host import blank
from cellwatt.registry import available, load

EXIT_FAILED = 1
"""The command ran and the answer is no (a check failed, the demo lost data)."""
EXIT_USAGE = 2
"""The command line or a settings file is wrong."""
EXIT_ERROR = 3
"""A device, file or link failed, so the command could not do its work."""
EXIT_BUG = 70
"""A bug in cellwatt or in a package that it loaded; the number is EX_SOFTWARE of sysexits.h."""

TRACEBACK: Final = "CELLWATT_TRACEBACK"
"""Environment variable: if set, the traceback of a bug goes to stderr instead of into a file."""
GROUPS: Final = {
    "Start": ("demo", "init", "check", "doctor", "drivers", "emulate"),
    "Run": ("run", "record", "health", "secure", "notify", "diagnose"),
    "Look": ("watch", "view", "plot", "export", "replay"),
    "Simulation": ("explain", "simulate"),
    "Energy and faults": ("disaggregate", "energy-campaign", "reference", "faults", "train", "predict"),
    "Fleet": ("fleet",),
    "Develop": ("new-driver", "new-outlet"),
}
"""Commands under each heading of the help; commands not listed here come last."""
_FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_BARRED: Final = (errno.EACCES, errno.EPERM, errno.ENAMETOOLONG)
FOLDER: Final = click.Path(file_okay=False, path_type=Path)
FILE: Final = click.Path(dir_okay=False, path_type=Path)
EXISTING: Final = click.Path(exists=True, dir_okay=False, path_type=Path)
"""Types of options and arguments: a folder, a file, a file that must exist."""


class Commands(click.Group):
    """A command group whose commands are the entry points of the group ``points``."""

    points = "cellwatt.commands"
    headings: Mapping[str, tuple[str, ...]] = GROUPS

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, sorted."""
        return list(available(self.points))

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return the named command, a command that reports why it cannot be loaded, or None if it is unknown."""
        if name not in available(self.points):
            return None
        try:
            command: click.Command = load(self.points, name)
        except ConfigError as error:
            return _unloadable(name, error)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings."""
        remaining = self.list_commands(ctx)
        for heading, names in (*self.headings.items(), ("Others" if self.headings else "Commands", remaining)):
            listed = [name for name in names if name in remaining]
            remaining = [name for name in remaining if name not in listed]
            rows = [(n, c.get_short_help_str(100)) for n in listed if (c := self.get_command(ctx, n)) is not None]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows, col_max=20)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return the command names without click's help texts, which would import every command."""
        names = [CompletionItem(name) for name in self.list_commands(ctx) if name.startswith(incomplete)]
        return [*names, *click.Command.shell_complete(self, ctx, incomplete)]


def _unloadable(name: str, error: ConfigError) -> click.Command:
    """Return a command that reports why it cannot be loaded, so that the help of all others can still be shown."""

    def fail(**_: object) -> None:
        raise error

    anything = click.Argument(["arguments"], nargs=-1, type=click.UNPROCESSED)
    settings = {"ignore_unknown_options": True}
    return click.Command(name, settings, fail, [anything], short_help=str(error), add_help_option=False)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="cellwatt")
def cli() -> None:
    """Edge daemon for robot cells: measure, align, record, and say what is wrong."""


def main() -> None:
    """Run the command line; print an error for the user as one line, without a traceback."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal of Latin-1 has no "…"
    try:
        code = cli(standalone_mode=False)
    except click.Abort:
        sys.exit(130)
    except click.ClickException as error:
        error.show()
        sys.exit(EXIT_USAGE)
    except ConfigError as error:
        click.echo(str(error), err=True)
        sys.exit(EXIT_USAGE)
    except CellwattError as error:
        click.echo(f"cellwatt: {blank(str(error))}", err=True)
        sys.exit(EXIT_ERROR)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name and not error.name.startswith("cellwatt"):
            click.echo(f"cellwatt: this needs the package {error.name}: pip install 'cellwatt[all]'", err=True)
            sys.exit(EXIT_USAGE)
        if isinstance(error, OSError) and (error.errno in _FULL or (error.errno in _BARRED and error.filename)):
            done = "written" if error.errno in _FULL else "opened"
            click.echo(f"cellwatt: {error.filename or 'the output'} cannot be {done}: {error.strerror}", err=True)
            sys.exit(EXIT_ERROR)
        _report_bug(error)
        sys.exit(EXIT_BUG)
    sys.exit(code if isinstance(code, int) else 0)


def _report_bug(error: Exception) -> None:
    """Report in one line that this is a bug in cellwatt, and where its traceback is."""
    text = blank("".join(traceback.format_exception(error)))
    summary = blank(" ".join(f"{type(error).__name__}: {error}".split()))
    hint = f"set {TRACEBACK}=1 to see where it is"
    if os.environ.get(TRACEBACK):
        click.echo(text, err=True)
        hint = "the traceback is above"
    else:
        try:
            with tempfile.NamedTemporaryFile("w", prefix="cellwatt-", suffix=".traceback", delete=False) as file:
                file.write(text)
            hint = f"the traceback is in {file.name}"
        except OSError:
            pass
    click.echo(f"cellwatt: this is a bug in cellwatt, please report it: {summary} ({hint})", err=True)
