"""Stages that need each other are one chain, in the order of their needs."""

from __future__ import annotations

import pytest

from cellwatt import CellwattError, Stage, StageSettings
from cellwatt.runtime.assemble import chain_names
from cellwatt.runtime.chain import group_by_needs
from tests.daemon.runtime.fakes import FakeStage, config_of, stages


def stage(*needs: str) -> type[Stage[StageSettings]]:
    return type("Needing", (FakeStage,), {"needs": needs})


def test_groups_share_nothing() -> None:
    stages = {"faults": stage("segment"), "power": stage(), "segment": stage()}
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
    with pytest.raises(CellwattError, match="circle"):
        group_by_needs({"a": stage("b"), "b": stage("a")}, {"a": "a", "b": "b"})
