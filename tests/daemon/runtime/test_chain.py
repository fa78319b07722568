"""Stages run in the order of their needs, and one that breaks leaves the others alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from cellwatt import CellInfo, CellwattError, FrameChannel, Frames, Layout, Stage, StageSettings
from cellwatt.results import Prediction, Result
from cellwatt.runtime.assemble import chain_names
from cellwatt.runtime.chain import Chain, group_by_needs
from tests.daemon.runtime.fakes import config_of, stages

LAYOUT = Layout((FrameChannel("arm.joint_1.position", "rad", "continuous", "linear"),), 50.0)
INFO = CellInfo("site", "cell", None, Path())


def frames(n: int, second: float = 0.0) -> Frames:
    time = np.array([round(second * 1e9)], np.int64)
    return Frames(LAYOUT, n, time, np.zeros((1, 1)), np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.int64))


class Echo(Stage[StageSettings]):
    title = "gives what it saw"
    Settings = StageSettings
    seen: ClassVar[list[int]] = []

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        return [Prediction(self.name, frames.sequence, (), {"upstream": tuple(float(len(upstream)) for _ in (0,))}, {})]


class Follower(Echo):
    needs = ("echo",)


def build(**classes: type[Echo]) -> Chain:
    makers = {n: (lambda n=n, c=c: c(n, StageSettings(), LAYOUT, INFO)) for n, c in classes.items()}
    return Chain(makers, {n: make() for n, make in makers.items()})


def test_results_flow_downstream() -> None:
    given = build(first=Echo, second=Follower).process(frames(0))
    assert [(r.model, r.outputs["upstream"][0]) for r in given if isinstance(r, Prediction)] == [
        ("first", 0.0),
        ("second", 1.0),
    ]


def test_groups_share_nothing() -> None:
    def stage(needs: tuple[str, ...]) -> Stage[StageSettings]:
        return type("S", (Echo,), {"needs": needs})("s", StageSettings(), LAYOUT, INFO)

    stages = {"faults": stage(("segment",)), "power": stage(()), "segment": stage(())}
    kinds = {"faults": "faults", "power": "model", "segment": "segment"}
    groups = group_by_needs(stages, kinds)
    assert sorted(groups, key=len) == [["power"], ["segment", "faults"]]


def test_more_chains_than_processes_share_them() -> None:
    names = [f"tasks_{n}" for n in range(32)]
    chains = chain_names(config_of(stages=stages(*names)), 8)
    assert [len(chain) for chain in chains] == [4] * 8
    assert sorted(name for chain in chains for name in chain) == sorted(names)
    assert chain_names(config_of(stages=stages(*names[:8])), 8) == [[name] for name in names[:8]]


def test_circle_is_refused() -> None:
    def stage(needs: tuple[str, ...]) -> Stage[StageSettings]:
        return type("S", (Echo,), {"needs": needs})("s", StageSettings(), LAYOUT, INFO)

    with pytest.raises(CellwattError, match="circle"):
        group_by_needs({"a": stage(("b",)), "b": stage(("a",))}, {"a": "a", "b": "b"})
