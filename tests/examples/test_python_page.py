"""docs/python.md does what it says."""

import re
from typing import Any

import numpy as np
import pytest

from cellwatt.frames import Frames
from tests.daemon.outlets.zenoh.processes import Child, free_port

from .conftest import ROOT

PAGE = ROOT / "docs" / "python.md"


@pytest.fixture
def names(workspace) -> dict[str, Any]:
    """What is defined once every block of the page was run, in order."""
    out: dict[str, Any] = {}
    for block in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        exec(compile(block, str(PAGE), "exec"), out)
    return out


def test_the_page_runs(names, workspace, capsys):
    assert names["frame"].shape == (200, 6) and len(names["part"]) == 76
    assert len(names["raw"]) == 100
    assert [effect.effect for effect in names["found"].findings.findings] == ["torque_offset"]
    assert names["found"].findings.findings[0].joint == 3
    assert np.allclose(names["frames"][:, :, 3, 3], 1)
    assert (workspace / "position.html").exists() and (workspace / "report.html").exists()
    for name in ("train_static", "train_power", "predict", "reference", "faults", "disaggregate", "simulate"):
        assert getattr(names["cw"], name).__doc__ and name in dir(names["cw"])


def test_the_subscription(names):
    port = free_port()
    with Child("cell_process", listen=[f"tcp/127.0.0.1:{port}"]) as cell:
        cell.ready()
        topic, content = names["first_message"](f"tcp/127.0.0.1:{port}")
    assert topic.split("/")[0] in ("raw", "frame", "health", "event", "alarm")
    assert content is not None and (topic != "frame" or isinstance(content, Frames))
