"""The questions of ``cellwatt init``: each says what the answer is for, and has a default where there is one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import click

from cellwatt.config import SourceConfig
from cellwatt.config.installed import installed
from cellwatt.config.reference import Field, reference
from cellwatt.config.wording import first_sentence
from cellwatt.errors import ConfigError
from cellwatt.first_cell.find import look, serial_ports, told
from cellwatt.first_cell.plan import SourcePlan, address_settings, check_name, in_yaml, questions, unreachable
from cellwatt.first_cell.write import arms_of, source_config
from cellwatt.progress.terminal import show_table
from cellwatt.registry import driver as find_driver
from cellwatt.runtime.assemble import streams_of

_UNNAMED = "device"


def ask(question: str, why: str, default: str = "") -> str:
    """Ask with the reason above the question; an empty answer is the default."""
    click.secho(f"\n{why}", dim=True)
    return str(click.prompt(question, default=default, show_default=bool(default))).strip()


def ask_sources(path: Path, known: Sequence[SourcePlan], connect: bool) -> Iterator[SourcePlan]:
    """Ask for devices until there is no more; with ``connect`` each is opened read-only and says who it is."""
    taken = [source.name for source in known]
    parts = installed("driver")
    click.echo()
    show_table(("driver", "reads"), [(p.name, p.title) for p in parts])
    while kind := ask(
        f"Driver of {'another' if taken else 'the first'} device" + " (Enter: no more)" * bool(taken),
        "A source is a device that is read: an arm, a power meter.",
        "" if taken else "ur",
    ):
        try:
            source, config = _device(path, kind)
            if connect:
                click.echo(f"asking it, read-only … {told(look(config, 2.0, 5.0))}")
            source = replace(source, name=_name(config, taken))
        except ConfigError as error:
            click.secho("; ".join(p.message for p in error.problems), fg="red")
            continue
        taken.append(source.name)
        yield source


def complete(source: SourcePlan) -> SourcePlan:
    """Ask for the address of a source and for its settings that have no usual value."""
    fields = {f.key: f for f in reference(source.model)}
    settings = dict(source.settings)
    if unreachable(source) or not settings:
        settings |= address_settings(source.model, _address(source, fields))
    for key in questions(source):
        if answer := ask(key, _meaning(fields[key]), fields[key].default):
            settings[key] = answer if answer != fields[key].default else in_yaml(answer)
    return replace(source, settings=settings)


def _device(path: Path, kind: str) -> tuple[SourcePlan, SourceConfig]:
    find_driver(kind)
    source = complete(SourcePlan(_UNNAMED, kind, {}))
    return source, source_config(path, source)


def _address(source: SourcePlan, fields: dict[str, Field]) -> str:
    ways = [fields[key] for key in source.model.reached_by if key in fields]
    if any(field.key != "host" for field in ways):
        ports = serial_ports()
        show_table(
            ("serial port", "device", ""), [(p.path, p.title, p.trouble) for p in ports] or [("none here", "", "")]
        )
    why = " ".join(f"{f.key}: {first_sentence(f.description)}." for f in ways)
    default = next((f.default for f in ways if f.default), "")
    while not (answer := ask(f"Address of the {source.driver} device", why, default)):
        click.echo("an address is needed, like 192.0.2.10, 192.0.2.10:502 or /dev/ttyUSB0")
    return answer


def _meaning(field: Field) -> str:
    return f"{field.description} [{field.type}]"


def _name(config: SourceConfig, taken: Sequence[str]) -> str:
    usual = "arm" if arms_of({config.name: streams_of(config)}) else "supply"
    default = next(name for name in (usual, *(f"{usual}_{n}" for n in range(2, 101))) if name not in taken)
    while True:
        name = ask("Name of this source", "It begins the names of its channels, as in arm.joint_1.position.", default)
        try:
            if name not in taken:
                return check_name(name)
            click.echo(f"{name} is there already")
        except ConfigError as error:
            click.echo(str(error))
