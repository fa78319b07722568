"""Shell completion. Names come from entry points, so that no plugin is imported to list them."""

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
    """``NAME=DRIVER:`` for each driver, once NAME and ``=`` are typed."""
    name, sign, driver = incomplete.partition("=")
    if not sign:
        return []
    return [CompletionItem(f"{name}={found.value}:") for found in starting(available("cellwatt.drivers"), driver)]


def or_files(words: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """Words that start with ``incomplete``, and file names."""
    return [CompletionItem(incomplete, type="file"), *starting(words, incomplete)]


def starting(words: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """Words that start with ``incomplete``."""
    return [CompletionItem(word) for word in words if word.startswith(incomplete)]
