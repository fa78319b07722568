import pytest
from rich.text import Text

from cellwatt.live import view
from cellwatt.live.lines import Column, table
from cellwatt.live.state import LiveCell
from cellwatt.live.view import Look
from tests.daemon.live.cells import START, alarm, energy, frames, health, interval, prediction, source, task

WIDE = Look(width=160)


def told(*messages):
    cell = LiveCell()
    for message in messages:
        cell.take(message)
    return cell


def lines(found):
    return [line.plain for line in found]


def test_energy_of_the_last_task_is_shown_with_its_groups_the_largest_first() -> None:
    assert view.energy(told(task(4))) == []
    (line,) = lines(view.energy(told(energy(3), energy(4))))
    assert "task_1 × 4" in line
    assert "65 J ± 0.5 J" in line
    assert line.endswith("electronics 60.0 · brakes 5.5 · unexplained -0.8 · regeneration 0.2")
    assert "stored" not in line  # nothing to tell


def test_each_group_is_shown_with_its_uncertainty() -> None:
    unsure = {"brakes": 0.125, "electronics": 1.0, "stored": 0.0, "regeneration": 0.25, "unexplained": 0.5}
    (line,) = lines(view.energy(told(energy(4, group_uncertainty=unsure))))
    assert line.endswith(
        "electronics 60.0 ± 1.00 · brakes 5.5 ± 0.12 · unexplained -0.8 ± 0.50 · regeneration 0.2 ± 0.25"
    )


def test_sources_with_their_account_and_their_errors() -> None:
    sources = {"arm": source(lost=3), "positioner": source("retrying", "nobody answers")}
    shown = lines(view.sources(told(health(sources=sources)), WIDE))
    assert shown[1].split() == ["arm", "ok", "main", "500.0", "Hz", "0.25", "ms", "0.12", "ms", "1000", "997", "3"]
    assert shown[-1] == "positioner: nobody answers"


def test_a_narrow_table_leaves_out_what_can_be_spared() -> None:
    columns = (Column("a"), Column("b", spare=2), Column("c", spare=1))
    assert lines(table(columns, [("xxxx", "yyyy", "zzzz")], 13)) == ["a     c", "xxxx  zzzz"]
    assert lines(table(columns, [("xxxxxxxxxxxxxxxxxxxx", "", "")], 10)) == ["a", "xxxxxxxxx…"]


@pytest.mark.parametrize("width", [40, 80, 100, 160])
def test_no_line_is_wider_than_the_screen(width: int) -> None:
    cell = told(health(warnings=["w" * 300]), task(4), energy(4), alarm("a", statement="word " * 60))
    for message in (
        frames(0, [100.0] * 50),
        prediction(0, [100.0] * 50),
        *(interval(n, (1, 2), 1.0) for n in range(40)),
    ):
        cell.take(message)
    look = Look(width=width)
    parts = (view.head, view.sources, view.motion, view.channels, view.alarms)
    assert all(line.cell_len <= width for part in parts for line in part(cell, look))


def test_the_last_intervals_are_shown_as_many_as_fit() -> None:
    cell = told(*(interval(n, (n,) if n % 2 else (), n / 10) for n in range(1, 30)), task(4))
    (line,) = lines(view.motion(cell, Look(width=80)))
    assert line.endswith("  task_1 × 4 (speed=1.00)")
    assert " 29  2.90s " in line
    assert " 9  0.90s " not in line


def test_a_channel_with_its_extremes() -> None:
    cell = told(frames(0, [100.0, 140.0, 90.0, 120.0]))
    header, line = lines(view.channels(cell, Look(width=100, channels=("board.*",))))
    assert header.endswith("last 10 s")
    assert line.split()[:5] == ["board.supply.power", "120.0", "W", "90.00", "140.0"]
    assert len(view.channels(cell, WIDE)) == 5
    assert lines(view.channels(cell, Look(channels=("weld.*",)))) == ["no such channel"]


def test_a_channel_that_is_missing_now_has_no_value_but_its_course() -> None:
    nan = float("nan")
    cell = told(frames(0, [100.0, nan]))
    assert lines(view.channels(cell, Look(channels=("board.*",))))[1].split()[1:3] == ["–", "W"]
    gone = told(frames(0, [nan, nan]))
    assert lines(view.channels(gone, Look(channels=("board.*",))))[1].split() == ["board.supply.power", "–", "W"]


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0.0000"), (-0.12345, "-0.1235"), (9.8765, "9.877"), (-82.5, "-82.50"), (4321.0, "4321"), (2e7, "2.0e+07")],
)
def test_numbers_have_four_digits(value: float, shown: str) -> None:
    assert view._number(value) == shown


def test_the_gravest_alarm_comes_first() -> None:
    cell = told(alarm("slow", severity="warning"), alarm("joint"), alarm("range", severity="info"))
    assert [line.split(":")[-1] for line in lines(view.alarms(cell, WIDE))] == [
        " joint is wrong.",
        " slow is wrong.",
        " range is wrong.",
    ]
    assert "error since 22:13:20:" in lines(view.alarms(cell, WIDE))[0]
    assert lines(view.alarms(told(health()), WIDE)) == ["no alarm"]


def test_a_silent_cell_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = told(health())
    cell.heard_at = START
    monkeypatch.setattr(view.time, "monotonic", lambda: cell.heard + 7.0)
    assert lines(view.head(cell, WIDE))[-1] == "no message for 7 s; last at 22:13:20"


def test_without_utf_8_it_is_ascii() -> None:
    cell = told(health(), task(4), energy(4), frames(0, [1.0, 2.0]), prediction(0, [1.0, 2.0]), interval(1, (), 1.0))
    assert view.whole(cell, Look(width=160, ascii=True)).plain.isascii()


def test_everything_on_one_page_waits_for_the_first_health() -> None:
    assert view.whole(LiveCell(), WIDE).plain == view.WAITING
    page = view.whole(told(health(), alarm("a")), WIDE, "recording ")
    assert isinstance(page, Text)
    assert page.plain.startswith("recording plant-1/weld-3 ● red  22:13:20 UTC")
    assert page.plain.splitlines()[1].endswith("a is wrong.")


def test_channels_have_the_lines_that_are_left() -> None:
    cell = told(health(), frames(0, [1.0, 2.0]))
    without = view.whole(cell, WIDE).plain.splitlines()
    high = view.whole(cell, WIDE, height=len(without) + 5).plain.splitlines()
    assert (high[: len(without)], high[len(without) + 1].split()[0]) == (without, "channel")
    assert len(high) == len(without) + 4
    assert view.whole(cell, WIDE, height=len(without) + 3).plain.splitlines() == without
