"""The bar that a person sees while a model is trained."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cellwatt_plugins.models.progress import progress_bar
from cellwatt_plugins.models.static import paper
from cellwatt_plugins.models.static.identify import HeldArm
from cellwatt_plugins.models.static.poses import Poses
from cellwatt_plugins.models.static.training import steps, train
from cellwatt_plugins.robot import Arm
from tests.plugins.models.static import arms


def test_a_terminal_shows_what_is_being_done_and_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar(4.0) as advance:
        advance(1.0, "smoothing")
    said = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err)
    assert "smoothing" in said
    assert "25%" in said


@pytest.mark.parametrize("quiet", [True, False])
def test_nothing_is_written_where_nobody_looks(monkeypatch, capsys, quiet):
    """With ``--json``, and where stderr is a file."""
    if quiet:
        monkeypatch.setenv("FORCE_COLOR", "1")
    else:
        monkeypatch.delenv("FORCE_COLOR", raising=False)
    with progress_bar(4.0, quiet=quiet) as advance:
        advance(1.0, "smoothing")
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_training_on_held_poses_ends_when_the_bar_is_full(tmp_path, monkeypatch):
    monkeypatch.setattr(paper, "TRIALS", 1)
    description = Arm.load(arms.write_robot(tmp_path, arms.Arm()))
    q = arms.within(arms.LIMITS, arms.halton(26))
    nothing = np.zeros_like(q)
    ways = np.vstack([q[:1], np.diff(q, axis=0)])
    poses = Poses(q, arms.Arm().load(q), nothing, np.ones(len(q), np.int64), ways, np.full(len(q), np.nan))
    done = []
    train(poses, HeldArm.of(description, q), lambda: done.append(1))
    assert len(done) == steps(len(q))
