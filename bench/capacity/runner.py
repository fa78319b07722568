"""The command line: which parts, how long, how often, and the prices."""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from dataclasses import fields, replace
from importlib import import_module
from typing import Any

from capacity import cost, page
from capacity.model import DAYS

PARTS = ("router", "subscribers", "record", "lake")
"""Modules of the package, each loaded when it is asked for."""
_PRICES = {
    "gb_month": "a GB and month",
    "puts_1000": "1,000 PUT, LIST and parts of uploads",
    "gets_1000": "1,000 GET and HEAD",
    "egress_gb": "a GB that leaves the provider",
    "core_hour": "a core and hour of commands over the lake",
}


def main() -> None:
    """Measure what is asked for, print it."""
    asked = _parser().parse_args()
    found: dict[str, Any] = {"machine": f"{platform.machine()}, Python {platform.python_version()}"}
    for name in [name for name in PARTS if name in asked.only]:
        began = time.monotonic()
        found[name] = import_module(f"capacity.{name}").measure(asked.seconds, asked.repeats)
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    told = [f"## {name}\n\n{page.PAGES[name](found[name])}" for name in PARTS if name in found]
    if "cost" in asked.only:
        told.append("## cost\n\n" + cost.table(*_question(asked)))
    print("\n\n".join(told) if asked.markdown else json.dumps(found))


def _question(asked: argparse.Namespace) -> tuple[cost.Question, Any]:
    given = {name: getattr(asked, f"price_{name}") for name in _PRICES}
    prices = replace(cost.LISTS[asked.prices], **{name: value for name, value in given.items() if value is not None})
    return cost.Question(**{field.name: getattr(asked, field.name) for field in fields(cost.Question)}), prices


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Capacity by measurement; docs/capacity.md says what is measured.")
    parser.add_argument("--only", nargs="+", choices=[*PARTS, "cost"], default=[*PARTS, "cost"], metavar="PART")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of a run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--markdown", action="store_true", help="the tables of the page instead of JSON")
    of = parser.add_argument_group("cost")
    of.add_argument("--cells", type=int, default=1000)
    of.add_argument("--channels", type=int, default=cost.CHANNELS)
    of.add_argument(
        "--weeks-read", type=float, default=1.0, help="how often a day a week of a channel is read, all cells"
    )
    of.add_argument("--outside", type=float, default=1.0, help="share of what is read that leaves the provider")
    of.add_argument("--kept-days", type=float, default=DAYS)
    of.add_argument("--core-hours", type=float, default=0.0, help="of commands over the lake, a cell and day")
    of.add_argument("--prices", choices=list(cost.LISTS), default=next(iter(cost.LISTS)), help="list to start from")
    for name, text in _PRICES.items():
        of.add_argument(f"--price-{name.replace('_', '-')}", type=float, help=text)
    return parser
