"""Streams, frames and stages of a cell, built from its settings without connecting to any device."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn, TypeVar, cast

from pydantic import ValidationError

from cellwatt.account import Account
from cellwatt.align import Aligner
from cellwatt.channel import Stream
from cellwatt.config import CellConfig, FrameSettings, SourceConfig, StageConfig
from cellwatt.config.installed import Installed
from cellwatt.config.places import first
from cellwatt.driver import Inlet, SourceSettings
from cellwatt.errors import CellwattError, ConfigError, Problem
from cellwatt.frames import Layout
from cellwatt.record.rows import MOST_VALUES
from cellwatt.registry import driver as find_driver
from cellwatt.registry import stage as find_stage
from cellwatt.runtime.chain import Chain, group_by_needs
from cellwatt.stage import CellInfo, Stage

TYPICAL = {"host": "192.0.2.10", "port": "/dev/ttyUSB0"}
"""Placeholder addresses for the settings that most drivers require."""

T = TypeVar("T")
Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Prepared:
    """Streams by source, the columns of the frames, and the stages in chains that share no results."""

    streams: dict[str, tuple[Stream, ...]]
    layout: Layout
    chains: list[Chain]

    @property
    def stages(self) -> dict[str, Stage[Any]]:
        """All stages by name; each comes after the stages that it needs."""
        return {name: stage for chain in self.chains for name, stage in chain.stages.items()}


def prepare(config: CellConfig) -> Prepared:
    """Build streams, layout and stages of a cell without opening a device.

    Raises ``ConfigError`` with every source and stage whose settings do not fit the cell: a channel declared
    twice, a model of another robot or with other units, a damaged file.
    """
    streams, layout = declared(config)
    return Prepared(streams, layout, make_chains(config, layout))


def declared(config: CellConfig) -> tuple[dict[str, tuple[Stream, ...]], Layout]:
    """Streams that the sources of a cell will deliver, and the columns of its frames.

    Raises ``ConfigError`` with every source whose settings do not fit.
    """
    streams = _each(streams_of, config.sources)
    return streams, layout_of(streams, config.frames)


def streams_of(source: SourceConfig) -> tuple[Stream, ...]:
    """Streams that a source will deliver. Raises ``ConfigError`` if its settings contradict each other."""
    with _placed(source.place, f"sources.{source.name}"):
        streams = find_driver(source.driver)(source.name, source.settings, cast("Inlet", _Unconnected())).streams
        counts = Counter(name for stream in streams for name in stream.names)
        twice = sorted(name for name, count in counts.items() if count > 1)
        if twice:
            raise ConfigError(f"gives {', '.join(twice)} more than once")
    return streams


def typical_streams(part: Installed) -> tuple[Stream, ...]:
    """Streams of an installed driver with default settings; empty if it requires further settings."""
    if part.kind != "driver" or part.settings is None:
        return ()
    try:
        required = {name for name, field in part.settings.model_fields.items() if field.is_required()}
        settings = part.settings.model_validate({k: TYPICAL[k] for k in TYPICAL if k in required})
        return streams_of(SourceConfig("source", part.name, cast("SourceSettings", settings)))
    except (ValidationError, ConfigError):
        return ()


def layout_of(streams: Mapping[str, tuple[Stream, ...]], frames: FrameSettings) -> Layout:
    """The columns of the frames, with the method of each.

    Raises ``ConfigError`` as ``Aligner`` does, and if they are more than a recording takes.
    """
    layout = Aligner(streams, frames.rate, frames.latency).layout
    if len(layout.channels) > MOST_VALUES:
        found = f"found {len(layout.channels):,} channels in all sources, expected at most {MOST_VALUES:,}"
        raise ConfigError([Problem("", "sources", f"{found}: give some sources a cell of their own")])
    return layout


def make_chains(config: CellConfig, layout: Layout) -> list[Chain]:
    """The stages of a cell, ready to run, in chains that share no results.

    Raises ``ConfigError`` with every stage whose settings do not fit the layout.
    """
    groups = {" ".join(group): group for group in chain_names(config)}
    return list(_each(lambda group: make_chain(config, layout, group), groups).values())


def chain_names(config: CellConfig, most: int | None = None) -> list[list[str]]:
    """Stage names of a cell in chains that share no results, each in running order.

    If there are more than ``most`` chains, the shortest are joined.
    """
    kinds = {name: stage.kind for name, stage in config.stages.items()}
    chains = group_by_needs({name: find_stage(kind) for name, kind in kinds.items()}, kinds)
    while most is not None and len(chains) > most:
        shortest, next_one, *others = sorted(chains, key=len)
        chains = [*others, shortest + next_one]
    return chains


def make_chain(config: CellConfig, layout: Layout, names: Sequence[str]) -> Chain:
    """The stages ``names`` as one chain, ready to run.

    Raises ``ConfigError`` with every stage whose settings do not fit the layout.
    """
    cell = CellInfo(config.site, config.cell, config.robot, config.folder)
    makers = {name: partial(_made, config.stages[name], layout, cell) for name in names}
    return Chain(makers, _each(lambda make: make(), makers))


def _made(stage: StageConfig, layout: Layout, cell: CellInfo) -> Stage[Any]:
    """Create a stage. Raises ``ConfigError`` with its position in the file."""
    with _placed(stage.place, f"stages.{stage.name}"):
        return find_stage(stage.kind)(stage.name, stage.settings, layout, cell)


@contextmanager
def _placed(place: str, path: str) -> Iterator[None]:
    """Add the position in the settings file to errors of a driver or stage under construction."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(
            [p if p.place else Problem(place, p.path or path, p.message) for p in error.problems]
        ) from error
    except (CellwattError, ValueError, OSError) as error:
        raise ConfigError([Problem(place, path, " ".join(str(error).split()))]) from error


def _each(make: Callable[[T], Made], given: Mapping[str, T]) -> dict[str, Made]:
    """Apply ``make`` to each value of ``given``. Raises ``ConfigError`` with the problems of all."""
    problems: list[Problem] = []
    made: dict[str, Made] = {}
    for name, one in given.items():
        try:
            made[name] = make(one)
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(first(problems))
    return made


class _Unconnected:
    """The inlet of a driver that is created only for its list of streams."""

    def __init__(self) -> None:
        self.account = Account()

    def __getattr__(self, name: str) -> NoReturn:
        raise RuntimeError("a driver talks only while it runs")
