"""The dashboard at the keys, on a small and on a large screen."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import pytest
from textual.pilot import Pilot
from textual.widgets import Footer, Input

from cellwatt.live.app import LiveApp
from cellwatt.live.view import Look
from cellwatt.subscriber import Message
from tests.daemon.live.cells import START, alarm, energy, frames, gap, health, interval, prediction, task
from tests.patience import PATIENCE

SMALL, LARGE = (80, 24), (160, 50)
CELL = (
    health(),
    *(interval(n, (n,), 1.0) for n in range(1, 4)),
    task(4),
    energy(4),
    frames(0, [100.0, 140.0, 180.0]),
    prediction(0, [103.0, 137.0, 183.0]),
    alarm("elbow"),
    alarm("mains", severity="warning", joint=None),
    alarm("mains", active=False, statement="mains is well.", time=START + 9),
)


@asynccontextmanager
async def running(
    size: tuple[int, int] = SMALL, messages: tuple[Message, ...] = CELL, look: Look | None = None
) -> AsyncIterator[tuple[LiveApp, Pilot[None]]]:
    """The dashboard once it has taken the messages."""
    over, taken = threading.Event(), threading.Event()

    def feed() -> Iterator[Message | None]:
        yield from messages
        taken.set()
        while not over.wait(0.01):
            yield None

    app = LiveApp(feed(), look or Look())
    try:
        async with app.run_test(size=size) as pilot:
            assert await asyncio.to_thread(taken.wait, PATIENCE)
            await seen(app, pilot)
            yield app, pilot
    finally:
        over.set()


async def seen(app: LiveApp, pilot: Pilot[None], *keys: str) -> list[str]:
    """The lines of the screen after some keys."""
    await pilot.press(*keys)
    app.draw()
    await pilot.pause()
    return ["".join(part.text for part in strip).rstrip() for strip in app.screen._compositor.render_strips()]


@pytest.mark.parametrize("size", [SMALL, LARGE])
async def test_pages_and_the_keys_at_the_foot(size: tuple[int, int]) -> None:
    async with running(size) as (app, pilot):
        for page, words in {
            "1": ("error since 22:13:20: elbow is wrong.", "500.0 Hz", "task_1 × 4", "off 3.0 W rms", "arm.joint_1"),
            "2": ("arm.joint_2.position", "mains.supply.power", "480.0 W"),
            "3": ("error   joint 3  elbow is wrong.", "cleared          mains is wrong."),
            "4": ("task_1", "65 J", "electronics 60.0"),
        }.items():
            lines = await seen(app, pilot, page)
            assert len(lines) == size[1]
            assert lines[0].startswith("plant-1/weld-3 ● red  22:13:20 UTC")
            assert " 3 alarms (1) " in lines[1]
            assert all(any(word in line for line in lines) for word in words), (page, lines)
            assert "c channels s 10/60 s u UTC/local space pause ? help q quit" in lines[-1]


async def test_tab_goes_through_the_pages() -> None:
    async with running() as (app, pilot):
        pages = [app.page]
        for _ in range(4):
            await pilot.press("tab")
            pages.append(app.page)
        assert pages == ["overview", "channels", "alarms", "energy", "overview"]
        await pilot.press("shift+tab")
        assert app.page == "energy"


async def test_enter_shows_an_alarm_whole() -> None:
    async with running() as (app, pilot):
        lines = " ".join(" ".join(await seen(app, pilot, "3", "enter")).split())
        assert "residual_W 12.5" in lines
        assert "or else joint 2" in lines
        assert "residual_W" not in " ".join(await seen(app, pilot, "escape"))
        assert "cleared by mains is well." in " ".join(" ".join(await seen(app, pilot, "down", "enter")).split())


async def test_channels_are_filtered_and_chosen() -> None:
    async with running() as (app, pilot):
        listed = await seen(app, pilot, "2", "c", *"supply")
        assert [line.split("|")[1].split() for line in listed if "[ ]" in line] == [
            ["[", "]", "board.supply.power"],
            ["[", "]", "mains.supply.power"],
        ]
        assert app.screen.query_one(Input).value == "supply"
        await pilot.press("down", "enter", "escape")
        assert app.look.channels == ("mains.supply.power",)
        shown = await seen(app, pilot)
        assert any("mains.supply.power" in line for line in shown)
        assert not any("board.supply.power" in line for line in shown)
        await pilot.press("c", "ctrl+a")
        assert app.look.channels == ()


async def test_patterns_of_the_command_line_choose_channels() -> None:
    async with running(look=Look(channels=("*.joint_2.*",))) as (app, pilot):
        shown = await seen(app, pilot, "2")
        assert [line.split()[0] for line in shown if "joint_" in line] == ["arm.joint_2.position"]


async def test_a_pause_holds_the_page_but_not_the_alarms() -> None:
    cell = [*CELL]
    async with running(messages=tuple(cell)) as (app, pilot):
        await seen(app, pilot, "space")
        app._cell.take(alarm("wrist"))
        lines = await seen(app, pilot)
        assert lines[0].startswith("paused  plant-1/weld-3")
        assert " 3 alarms (2) " in lines[1]
        assert not any("wrist" in line for line in lines)
        assert any("wrist" in line for line in await seen(app, pilot, "space"))


async def test_span_clock_and_help() -> None:
    async with running() as (app, pilot):
        assert any("last 10 s" in line for line in await seen(app, pilot, "2"))
        assert any("last 60 s" in line for line in await seen(app, pilot, "s"))
        await pilot.press("u")
        assert not app.look.utc
        assert any("evidence and alternatives" in line for line in await seen(app, pilot, "question_mark"))
        await pilot.press("escape", "q")
        await pilot.pause()
        assert not app.is_running


async def test_it_follows_the_size_of_the_terminal() -> None:
    async with running(SMALL) as (app, pilot):
        assert not any("stream" in line for line in await seen(app, pilot))
        await pilot.resize_terminal(*LARGE)
        lines = await seen(app, pilot)
        assert any("stream" in line for line in lines)
        await pilot.resize_terminal(30, 10)
        assert all(len(line) <= 30 for line in await seen(app, pilot))


async def test_a_cell_that_says_nothing_yet() -> None:
    async with running(messages=()) as (app, pilot):
        for page in "1234":
            assert "waiting for the cell's first health message" in (await seen(app, pilot, page))[0]
        await pilot.press("c")  # no channels to choose yet
        assert len(app.screen_stack) == 1


async def test_without_colours_every_state_is_still_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with running() as (app, pilot):
        lines = await seen(app, pilot, "3")
        assert "● red" in lines[0]
        assert any("error" in line for line in lines)
        styles = [
            part.style
            for strip in app.screen._compositor.render_strips()
            for colourless in app._filters
            for part in strip.apply_filter(colourless, app.background_colors[1])
            if part.style and part.text.strip()
        ]
        assert styles
        for style in styles:
            front, back = style.color, style.bgcolor
            assert front and back and front.triplet and back.triplet
            assert len({*front.triplet}) == len({*back.triplet}) == 1, "a colour"
            assert abs(front.triplet[0] - back.triplet[0]) > 40, "text that cannot be read"


async def test_the_end_of_the_messages_ends_it_with_their_error() -> None:
    def feed() -> Iterator[Message | None]:
        yield from CELL
        raise ValueError("the link is gone")

    app = LiveApp(feed(), Look())
    async with app.run_test() as pilot:
        for _ in range(1000):
            if not app.is_running:
                break
            await pilot.pause(0.01)
    assert str(app.problem) == "the link is gone"


async def test_messages_are_taken_while_nothing_can_be_drawn() -> None:
    """A terminal that takes nothing holds up the drawing, which holds the loop; messages go on in their thread."""
    over, taken = threading.Event(), threading.Event()

    def feed() -> Iterator[Message | None]:
        yield from CELL
        for n in range(1000):
            yield frames(3 + n, [150.0])
        yield alarm("late")
        yield gap(1)
        taken.set()
        while not over.wait(0.01):
            yield None

    def hold_the_loop() -> bool:
        """Not a key is taken, nothing is drawn."""
        return taken.wait(PATIENCE)

    app = LiveApp(feed(), Look())
    async with app.run_test() as pilot:
        assert hold_the_loop()
        assert list(app._cell.alarms) == ["elbow", "late"]
        assert any("late" in line for line in await seen(app, pilot))
        assert app.query_one(Footer).region.bottom == 24
        over.set()  # the end of the messages ends the dashboard
