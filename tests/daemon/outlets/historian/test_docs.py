"""The page about the historian: its settings, and its programs on a lake."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.daemon.outlets.historian.made import ANOTHER, Recorded, row_truth
from tests.daemon.outlets.historian.test_lake import export
from tests.docs.pages import blocks

PAGE = "outlets/historian.md"


@pytest.fixture
def names(record: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the page's programs leave, run in order beside a lake of two minutes with other channels in the second."""
    Recorded(record).seconds(60).rotate()
    Recorded(record, layout=ANOTHER, second=60).seconds(60).close()
    export(record, tmp_path / "lake")
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    for block in blocks(PAGE, "python"):
        exec(compile("\n" * block.line + block.text, block.page, "exec"), found)
    return found


def mean_of(seconds: range) -> float:
    powers = [row_truth(second)["arm.bus.power"] for second in seconds]
    return float(np.mean([power for power in powers if power is not None]))


def test_programs_of_the_page_find_what_was_recorded(names: dict[str, Any]) -> None:
    # The row of the 60th second stands at the full minute.
    watts = [row[2] for row in names["power"]]
    assert watts[:2] == pytest.approx([mean_of(range(59)), mean_of(range(59, 119))])
    assert {row[0] for row in names["power"]} == {"weld-3"}
    ((task, times, joules, losses),) = names["energy"]
    repetitions = [second for second in range(120) if second % 5 == 2]
    assert (task, times) == ("task_1", len(repetitions))
    assert joules == pytest.approx(100 + np.mean(repetitions))
    assert losses == pytest.approx(60 + np.mean(repetitions))
    assert names["minutes"]["arm.bus.power"].to_list()[:2] == pytest.approx(watts[:2])
    assert len(names["alarms"]) == len(repetitions)
