"""``kill -9`` of a process that records."""

import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cellwatt.record import Recording, recover
from cellwatt.record.header import PART

ROOT = Path(__file__).resolve().parents[3]
RATE = 500
ALLOWED = RATE // 10
"""100 ms of samples."""


@pytest.mark.parametrize("number", range(2))
def test_a_killed_recorder_loses_at_most_100_ms(number, tmp_path):
    wanted = random.Random(number).randint(20, 300)
    folder = tmp_path / "record"
    command = [sys.executable, "-m", "tests.daemon.record.recording_process", folder, str(RATE)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            said, late = line.split()
            if int(said) >= wanted:
                break
        process.kill()
        for line in process.stdout:
            if line.endswith("\n"):
                said, late = line.split()
    parts = list(folder.glob(f"*{PART}"))
    reports = [recover(part) for part in parts]
    stored = 0
    if any(report and report.result for report in reports):
        recording = Recording.open(folder)
        samples = recording.batches("arm", "rtde")
        stored = len(samples)
        assert samples.sequence.tolist() == list(range(stored))
        assert np.array_equal(samples.values[:, 0], np.arange(stored))
        assert not recording.damage
    # A busy machine wakes the recorder late: once to write, and once while it does.
    assert int(said) + 1 - stored <= ALLOWED + 2 * RATE * float(late)
