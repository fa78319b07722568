"""Which tests one worker runs, and in what order: a file together, what takes longest first."""

from __future__ import annotations

TYPES = "tests/test_quality.py::test_tool_is_content[types]"

TOGETHER = {
    "tests/system": "timing",  # whole daemons beside another are late, not wrong
    "tests/daemon/record/test_kill.py": "timing",
    "tests/daemon/test_ticker.py": "timing",
    "tests/daemon/outlets/zenoh/plants": "timing",
    "tests/daemon/scheduler": "tests/daemon/scheduler",  # workers are started once
    "tests/plugins/energy": "tests/plugins/energy",  # a campaign and its fit are made once
    "tests/plugins/faults": "tests/plugins/faults",  # a reference is learnt once
    "tests/plugins/faults/cycles": "tests/plugins/faults/cycles",  # and all cycles are fitted once
    "tests/bench/concealed": "tests/bench/concealed",  # a case is simulated once
}
"""Files and folders that share a worker, by a common name; the longest path counts."""

FIRST = [
    TYPES,
    "timing",
    "tests/drivers/test_conformance.py",
    "tests/plugins/faults",
    "tests/drivers/ur/test_driver.py",
    "tests/bench/concealed",
    "tests/plugins/models/power/test_training.py",
    "tests/plugins/faults/cycles",
    "tests/plugins/models/static/test_training.py",
    "tests/plugins/energy",
    "tests/plugins/explain/test_explain.py",
    "tests/daemon/config/test_hostile.py",
    "tests/daemon/record/test_bombs.py",
    "tests/daemon/outlets/zenoh/test_link_cut.py",
    "tests/daemon/outlets/zenoh/test_processes.py",
    "tests/daemon/outlets/zenoh/test_secure.py",
    "tests/plugins/explain/input/test_admission.py",
    "tests/plugins/models/static/test_identify.py",
    "tests/daemon/testing/test_suite.py",
    "tests/plugins/explain/live/test_explanation.py",
    "tests/daemon/test_clock.py",
    "tests/plugins/explain/report/test_page.py",
    "tests/daemon/testing/test_examples.py",
    "tests/drivers/ur/test_library.py",
    "tests/plugins/explain/test_command.py",
    "tests/plugins/models/power/test_train_command.py",
    "tests/plugins/explain/simulators/test_mend.py",
    "tests/daemon/test_align.py",
    "tests/drivers/yaskawa/test_yaskawa_faults.py",
    "tests/plugins/explain/test_stage.py",
    "tests/science/test_energy_coverage.py",
    "tests/drivers/scpi_analyzer/test_scpi_faults.py",
    "tests/daemon/testing/test_new_driver.py",
    "tests/plugins/explain/fit/test_search.py",
    "tests/daemon/outlets/zenoh/test_hostile_bus.py",
]
"""What takes longer than 20 s beside other tests, longest first: whoever is done with it takes the small rest."""


def group(nodeid: str) -> str:
    """The name of what a test runs together with."""
    if nodeid == TYPES:
        return nodeid
    path = nodeid.partition("::")[0]
    shared = [place for place in TOGETHER if path == place or path.startswith(f"{place}/")]
    return TOGETHER[max(shared, key=len)] if shared else path


def turn(nodeid: str) -> int:
    """When its turn comes; the same number for all that nobody waits for."""
    name = group(nodeid)
    return FIRST.index(name) if name in FIRST else len(FIRST)
