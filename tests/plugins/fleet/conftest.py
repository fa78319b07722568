import json
from dataclasses import replace

import pytest

from tests.calling import called

WEEKS = 12


@pytest.fixture(scope="session")
def lake(tmp_path_factory):
    """Seven arms of one kind over twelve weeks: one wears, one gets a load, and some recordings are of no use."""
    from fleet.emulated import Arm, write_arm, write_kinds

    folder = tmp_path_factory.mktemp("plant")
    write_kinds(folder)
    arms = [Arm(f"weld-{i}", "weld", 40 + i) for i in range(7)]
    arms[2] = replace(arms[2], wear={3: 0.5})
    arms[4] = replace(arms[4], payload_from=6)
    for arm in arms:
        write_arm(folder, arm, WEEKS)
    cell = folder / "weld" / "weld-5"
    (cell / "2026-02-03_cut.parquet").write_bytes(b"PAR1 and no more")
    (cell / "2026-02-04_power_only.csv").write_text("t,power\n0,1\n1,2\n")
    for stray in (cell / "no_date.csv", folder / "stray.csv", folder / ".snapshot" / "weld-5" / "2026-02-05.csv"):
        stray.parent.mkdir(parents=True, exist_ok=True)
        stray.write_text("t,power\n0,1\n1,2\n")
    return folder


@pytest.fixture(scope="session")
def written(lake, tmp_path_factory):
    """The folder that the command wrote, fleet.json, and what it printed."""
    from cellwatt_plugins.fleet.command import fleet

    out = tmp_path_factory.mktemp("out")
    told = called(fleet, lake, "--out", out, "--quiet")
    return out, json.loads((out / "fleet.json").read_text()), told
