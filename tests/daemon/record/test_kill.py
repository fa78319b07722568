"""``kill -9`` of a process that records."""

import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cellwatt.record import Recording, recover
from cellwatt.record.header import PART

RATE = 500
ALLOWED = RATE // 10
"""100 ms of samples."""


@pytest.mark.parametrize("number", range(10))
def test_a_killed_recorder_loses_at_most_100_ms(number, tmp_path):
    program = Path(__file__).with_name("recording_process.py")
    wanted = random.Random(number).randint(20, 300)
    with subprocess.Popen([sys.executable, program, tmp_path, str(RATE)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) >= wanted:
                break
        process.kill()
        handed_over = [int(line) for line in process.stdout.read().splitlines() if line]
    said = handed_over[-1] if handed_over else wanted
    parts = list(tmp_path.glob(f"*{PART}"))
    reports = [recover(part) for part in parts]
    stored = 0
    if any(report and report.result for report in reports):
        recording = Recording.open(tmp_path)
        samples = recording.batches("arm", "rtde")
        stored = len(samples)
        assert samples.sequence.tolist() == list(range(stored))
        assert np.array_equal(samples.values[:, 0], np.arange(stored))
        assert not recording.damage
    assert said + 1 - stored <= ALLOWED
