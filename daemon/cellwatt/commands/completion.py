"""Words that the shell offers after TAB. Names come from entry points: nothing is imported to list them."""

from __future__ import annotations

from collections.abc import Iterable

import click
from click.shell_completion import CompletionItem

from cellwatt.registry import available


def drivers(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Names of drivers."""
    return starting(available("cellwatt.drivers"), incomplete)


def parts(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Names of drivers, stages and outlets."""
    groups = ("cellwatt.drivers", "cellwatt.stages", "cellwatt.outlets")
    return starting((name for group in groups for name in available(group)), incomplete)


def sources(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """``NAME=DRIVER:`` once the name and ``=`` are there."""
    name, sign, driver = incomplete.partition("=")
    if not sign:
        return []
    return [CompletionItem(f"{name}={found.value}:") for found in starting(available("cellwatt.drivers"), driver)]


def or_files(words: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """Words that start as what is typed, and files where none does."""
    return [CompletionItem(incomplete, type="file"), *starting(words, incomplete)]


def starting(words: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """Words that start as what is typed."""
    return [CompletionItem(word) for word in words if word.startswith(incomplete)]
