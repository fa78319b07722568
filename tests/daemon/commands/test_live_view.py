from dataclasses import asdict
from io import StringIO

from rich.console import Console

from cellwatt import Energy, Task
from cellwatt.commands.live_view import LiveCell

STATUS = {
    "site": "plant-1",
    "cell": "weld-3",
    "state": "green",
    "time": 1_700_000_000 * 10**9,
    "recorder": None,
    "frames": {"count": 7},
    "results": 3,
    "sources": {},
}
GROUPS = {"brakes": 5.5, "electronics": 60.0, "stored": 0.0, "regeneration": 0.25, "unexplained": -0.75}


def shown(view):
    page = StringIO()
    Console(width=160, file=page).print(view.render())
    return page.getvalue()


def test_energy_of_the_last_task_is_shown_with_its_groups_the_largest_first():
    view = LiveCell()
    view.add("health", STATUS)
    assert "energy" not in shown(view)
    view.add("task", asdict(Task("arm", "task_1", "1-2", "speed=1.00", 1.0, 0, 9, (1, 2), 4)))
    for repetition in (3, 4):
        energy = Energy("arm", "task_1", "speed=1.00", repetition, 0, 9, 65.0, GROUPS, 0.5, 9.0, 13.8)
        view.add("energy", asdict(energy))
    (line,) = (line for line in shown(view).splitlines() if line.startswith("energy"))
    assert "task_1 × 4" in line
    assert "65 J ± 0.5 J" in line
    assert line.endswith("electronics 60.0 · brakes 5.5 · unexplained -0.8 · regeneration 0.2")
    assert "stored" not in line  # nothing to tell


def test_each_group_is_shown_with_its_uncertainty():
    unsure = {"brakes": 0.125, "electronics": 1.0, "stored": 0.0, "regeneration": 0.25, "unexplained": 0.5}
    energy = Energy("arm", "task_1", "speed=1.00", 4, 0, 9, 65.0, GROUPS, 0.5, 9.0, 13.8, group_uncertainty=unsure)
    view = LiveCell(status=STATUS)
    view.add("energy", asdict(energy))
    (line,) = (line for line in shown(view).splitlines() if line.startswith("energy"))
    assert line.endswith(
        "electronics 60.0 ± 1.00 · brakes 5.5 ± 0.12 · unexplained -0.8 ± 0.50 · regeneration 0.2 ± 0.25"
    )


def test_what_it_does_not_show_is_let_by():
    view = LiveCell(status=STATUS)
    before = shown(view)
    view.add("event", {"kind": "source_state"})
    assert shown(view) == before
