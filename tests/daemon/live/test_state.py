from dataclasses import asdict, replace

from cellwatt.live import state
from cellwatt.live.state import LiveCell
from tests.daemon.live.cells import START, alarm, energy, frames, health, hear, interval, prediction, task


def told(*messages):
    cell = LiveCell()
    for message in messages:
        hear(cell, message)
    return cell


def test_an_alarm_is_active_until_it_is_cleared_and_keeps_its_evidence() -> None:
    cell = told(alarm("a"), alarm("b"), alarm("a", statement="a is worse."))
    assert {s.alarm.id: s.alarm.statement for s in cell.alarms.up} == {"a": "a is worse.", "b": "b is wrong."}
    hear(cell, alarm("a", active=False, statement="a is well again.", time=START + 9, evidence={}))
    (cleared,) = cell.cleared
    assert list(cell.alarms) == ["b"]
    assert cleared.over is not None
    assert (cleared.alarm.statement, cleared.over.statement) == ("a is worse.", "a is well again.")
    assert (cleared.alarm.evidence, cleared.over.time) == ({"residual_W": 12.5}, START + 9)


def test_health_tells_the_alarms_that_were_not_heard() -> None:
    standing = asdict(alarm("a").content)
    assert list(told(health(alarms=[standing])).alarms) == ["a"]
    assert list(told(health(), health(alarms=[standing])).alarms) == ["a"]
    cleared = told(health(), alarm("a"), alarm("a", active=False, time=START + 1), health(alarms=[standing]))
    assert not list(cleared.alarms), "it was cleared after that health was taken"


def test_a_new_session_of_the_daemon_ends_alarms_and_tasks_of_the_old_one() -> None:
    """The new daemon may call another motion task_1. The PC's clock was set back, and alarm b holds still."""
    standing = asdict(alarm("b").content)
    cell = told(health(), alarm("a"), alarm("b"), task(4), energy(4, 64.0), health(session=2, alarms=[standing]))
    assert (cell.restarts, cell.session, list(cell.alarms)) == (1, 2, ["b"])
    assert (cell.task, cell.energies) == (None, {})
    assert [(s.alarm.id, s.over.time) for s in cell.cleared if s.over] == [("a", alarm("a").content.time)]


def test_cleared_alarms_beyond_the_limit_are_counted() -> None:
    cell = LiveCell()
    for n in range(state.CLEARED + 3):
        hear(cell, alarm(f"a{n}"))
        hear(cell, alarm(f"a{n}", active=False))
    assert (len(cell.cleared), cell.forgotten) == (state.CLEARED, 3)


def test_tasks_energies_frames_and_predictions_are_kept() -> None:
    cell = told(
        interval(1, (1,), 0.5),
        interval(2, (), 0.1, closed=False),
        task(4),
        energy(3, 60.0),
        energy(4, 64.0),
        frames(0, [1.0, 2.0]),
        prediction(0, [float("nan"), 3.0]),
    )
    assert [i.number for i in cell.intervals] == [1], "only closed ones"
    assert cell.task is not None and cell.task.repetition == 4
    assert [e.total for e in cell.energies["task_1"]] == [60.0, 64.0]
    assert cell.frames.names[3] == "mains.supply.power"
    assert cell.frames.values[:, 3].tolist() == [301.0, 302.0]
    assert (cell.predicted["model"].names[0], cell.predicted["model"].values[1, 0]) == ("power", 3.0)


def test_energies_of_the_tasks_that_ran_last_are_kept() -> None:
    cell = LiveCell()
    for n in [*range(state.TASKS), 0, state.TASKS]:
        content = replace(energy(1, 60.0).content, task=f"task_{n}", end=START + len(cell.energies))
        hear(cell, replace(energy(1, 60.0), content=content))
    assert set(cell.energies) == {f"task_{n}" for n in range(state.TASKS + 1)} - {"task_1"}


def test_the_state_is_the_worse_of_the_daemons_and_that_of_the_alarms_as_on_the_page() -> None:
    raised = alarm("a").content
    known = {**asdict(raised), "acknowledged": {"name": "anna", "note": "", "time": START}}
    shelf = {"name": "anna", "note": "", "time": START, "until": START + 9, "severity": "error"}
    shelved = {name: getattr(raised, name) for name in ("id", "kind", "severity", "statement", "since")}
    assert told(health()).state == "green"
    assert told(health(), alarm("a")).state == "red"
    assert told(alarm("a"), health(alarms=[known])).state == "amber"
    assert told(alarm("a"), health(shelved=[{**shelved, "shelf": shelf}])).state == "green"
    assert told(health(state="amber")).state == "amber"
    assert told(health(), alarm("a"), alarm("a", active=False)).state == "green"
