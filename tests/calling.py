"""Commands as a person calls them, in this process."""

from __future__ import annotations

import click
from click.testing import CliRunner


def called(command: click.Command, *words: object) -> str:
    """What a command prints that succeeds; what it raises is raised."""
    done = CliRunner().invoke(command, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout
