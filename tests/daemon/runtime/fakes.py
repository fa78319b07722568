"""Devices, stages and receivers that do what a test tells them, found through entry points like any other."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt import (
    Alarm,
    Batch,
    Channel,
    Driver,
    FrameChannel,
    Frames,
    Identity,
    Layout,
    Outlet,
    OutletSettings,
    Reading,
    SourceSettings,
    Stage,
    StageSettings,
    Stream,
)
from cellwatt.config import CellConfig, FrameSettings, OutletConfig, SourceConfig, StageConfig
from cellwatt.record import RecordSettings
from cellwatt.results import Prediction, Result
from tests.daemon.runtime.one_process import Cell

STEP = 20_000_000
"""ns between samples and between frames: 50 Hz."""
STREAM = Stream("supply", (Channel("bus.voltage", "V"), Channel("bus.current", "A")), 50.0, "host")
LAYOUT = Layout((FrameChannel("arm.bus.voltage", "V", "continuous", "linear"),), 50.0)
WHO = Identity("Maker", "Model", "1", "2.3")

Order = Callable[[Any], Awaitable[None]]


async def until(condition: Callable[[], object]) -> None:
    """Wait until a condition holds; that it never does is told after some minutes."""
    pause = 0.001
    async with asyncio.timeout(150):
        while not condition():
            await asyncio.sleep(pause)
            pause = min(2 * pause, 0.02)


class Obeying:
    """Does one after another what the test tells it, while somebody runs it."""

    def __init__(self) -> None:
        self.orders: asyncio.Queue[Order] = asyncio.Queue()
        self.runs: list[float] = []
        """Time of the loop, s, at which each run began."""
        self.open = 0
        self.most_open = 0

    def tell(self, *orders: Order) -> None:
        for order in orders:
            self.orders.put_nowait(order)

    async def done(self) -> None:
        await self.orders.join()

    async def obey(self, who: Any) -> None:
        self.runs.append(asyncio.get_running_loop().time())
        self.open += 1
        self.most_open = max(self.open, self.most_open)
        try:
            while True:
                order = await self.orders.get()
                try:
                    await order(who)
                finally:
                    self.orders.task_done()
        finally:
            self.open -= 1


# devices ----------------------------------------------------------------------------------------------


async def _ours() -> Identity:
    return WHO


class Device(Obeying):
    """What a source reads."""

    def __init__(self) -> None:
        super().__init__()
        self.time = 0
        self.made = 0
        self.who: Callable[[], Awaitable[Identity]] = _ours


DEVICES: dict[str, Device] = defaultdict(Device)


class FakeSettings(SourceSettings):
    host: str
    note: str = ""


class FakeDriver(Driver[FakeSettings]):
    Settings = FakeSettings
    title = "Device of the tests"
    emulator = f"{__name__}:None"
    writes = ()

    @property
    def streams(self) -> tuple[Stream, ...]:
        return (STREAM,)

    async def run(self) -> None:
        await DEVICES[self.settings.host].obey(self)

    async def identify(self) -> Identity:
        return await DEVICES[self.settings.host].who()


async def answer(driver: FakeDriver) -> None:
    driver.inlet.connected(WHO)


def give(n: int) -> Order:
    """n samples of STREAM, 1 V more and 20 ms later each; their numbers go on over runs and drivers."""

    async def order(driver: FakeDriver) -> None:
        device = DEVICES[driver.settings.host]
        device.time = device.time or driver.inlet.now()
        for _ in range(n):
            device.time += STEP
            driver.inlet.account.expect()
            driver.inlet.emit(Reading(STREAM, np.array([[float(device.made), 1.0]]), device.time))
            device.made += 1
            if not device.made % 20:
                await asyncio.sleep(0)  # as a device does, which sends few at once

    return order


def drop(n: int, why: str) -> Order:
    async def order(driver: FakeDriver) -> None:
        driver.inlet.account.expect(n)
        driver.inlet.account.drop(n, why)

    return order


def fail(error: BaseException) -> Order:
    async def order(_: Any) -> None:
        raise error

    return order


def last(seconds: float) -> Order:
    """Stay as it is for so long."""

    async def order(_: Any) -> None:
        await asyncio.sleep(seconds)

    return order


async def hang(_: Any) -> None:
    await asyncio.Event().wait()


# stages -----------------------------------------------------------------------------------------------


class Judge:
    """What a stage of the tests does: note the frames and give what a test put in place."""

    def __init__(self) -> None:
        self.seen: list[int] = []
        self.made = 0
        self.refuse: Exception | None = None
        self.give: Callable[[Frames, Sequence[Result]], Sequence[Result]] = lambda _frames, _upstream: ()
        self.last: Callable[[], Sequence[Result]] = lambda: ()


JUDGES: dict[str, Judge] = defaultdict(Judge)


class JudgeSettings(StageSettings):
    note: str = ""


class FakeStage(Stage[JudgeSettings]):
    Settings = JudgeSettings
    title = "Judge of the tests"

    def __init__(self, name: str, *rest: Any) -> None:
        super().__init__(name, *rest)
        self.judge = JUDGES[name]
        self.judge.made += 1
        if self.judge.refuse is not None:
            raise self.judge.refuse

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        given = self.judge.give(frames, upstream)
        self.judge.seen += range(frames.sequence, frames.sequence + len(frames))
        return given

    def close(self) -> Sequence[Result]:
        return self.judge.last()


class AfterStage(FakeStage):
    needs = ("judge",)


def prediction(name: str, number: int) -> Prediction:
    return Prediction(name, number, (), {}, {})


def alarm(name: str = "heat", *, active: bool = True, stage: str | None = None) -> Alarm:
    return Alarm(name, "heat", "warning", active, 1, 2, f"Joint 2: {name}.", stage=stage)


def frames_of(first: int, n: int = 1, second: float | None = None) -> Frames:
    """n frames from number ``first`` on; the first at ``second``, or where its number puts it."""
    start = first * STEP if second is None else round(second * 1e9)
    time = start + np.arange(n, dtype=np.int64) * STEP
    return Frames(LAYOUT, first, time, np.zeros((n, 1)), np.zeros((n, 1), np.uint8), np.zeros((n, 1), np.int64))


# receivers --------------------------------------------------------------------------------------------


class Receiver(Obeying):
    """Where an outlet puts what it gets; ``refuse`` is raised for what is offered, ``refuse_health`` for health."""

    def __init__(self) -> None:
        super().__init__()
        self.items: list[Any] = []
        self.health: list[Mapping[str, Any]] = []
        self.refuse: Exception | None = None
        self.refuse_health: Exception | None = None

    def of(self, kind: type) -> list[Any]:
        return [item for item in self.items if isinstance(item, kind)]

    @property
    def values(self) -> list[int]:
        """Numbers of the samples that came, in order."""
        return [int(v) for b in self.of(Batch) for v in b.values[:, 0]]

    @property
    def frames(self) -> list[int]:
        """Numbers of the frames that came, in order."""
        return [n for f in self.of(Frames) for n in range(f.sequence, f.sequence + len(f))]

    @property
    def told(self) -> list[str]:
        """Kinds of the events that came, in order."""
        from cellwatt import Event

        return [event.kind for event in self.of(Event)]


RECEIVERS: dict[str, Receiver] = defaultdict(Receiver)


class ReceiverSettings(OutletSettings):
    note: str = ""


class FakeOutlet(Outlet[ReceiverSettings]):
    Settings = ReceiverSettings
    title = "Receiver of the tests"

    def offer(self, item: Any) -> None:
        receiver = RECEIVERS[self.name]
        if receiver.refuse is not None:
            raise receiver.refuse
        receiver.items.append(item)

    def health(self, status: Mapping[str, Any]) -> None:
        receiver = RECEIVERS[self.name]
        if receiver.refuse_health is not None:
            raise receiver.refuse_health
        receiver.health.append(status)

    async def run(self) -> None:
        await RECEIVERS[self.name].obey(self)


# cells ------------------------------------------------------------------------------------------------

POINTS = [
    EntryPoint(name, f"{__name__}:{value}", f"cellwatt.{group}")
    for group, name, value in (
        ("drivers", "fake", "FakeDriver"),
        ("stages", "judge", "FakeStage"),
        ("stages", "after", "AfterStage"),
        ("outlets", "bus", "FakeOutlet"),
        ("outlets", "zenoh", "FakeOutlet"),
        ("outlets", "other", "FakeOutlet"),
    )
]


def entry_points(group: str) -> list[EntryPoint]:
    """Stands for ``importlib.metadata.entry_points``."""
    return [p for p in POINTS if p.group == group]


def sources(*names: str, **notes: str) -> dict[str, SourceConfig]:
    return {n: SourceConfig(n, "fake", FakeSettings(host=n, note=notes.get(n, ""))) for n in names}


def stages(*names: str, **notes: str) -> dict[str, StageConfig]:
    return {n: StageConfig(n, "judge", JudgeSettings(note=notes.get(n, ""))) for n in names}


def outlets(*names: str, **notes: str) -> dict[str, OutletConfig]:
    return {n: OutletConfig(n, ReceiverSettings(note=notes.get(n, ""))) for n in names}


def config_of(**parts: Any) -> CellConfig:
    """A cell of one source ``arm`` and one outlet ``bus``, unless said otherwise."""
    usual: dict[str, Any] = {
        "path": Path("/cells/weld.yaml"),
        "text": "",
        "site": "plant",
        "cell": "weld",
        "robot": None,
        "sources": sources("arm"),
        "frames": FrameSettings(),
        "stages": {},
        "record": None,
        "outlets": outlets("bus"),
    }
    if isinstance(parts.get("record"), Path):
        parts["record"] = RecordSettings(folder=parts["record"])
    return CellConfig(**usual | parts)


async def look(cell: Cell, times: int = 1) -> Mapping[str, Any]:
    """The cell's health after it was looked at anew."""
    looked = asyncio.Event()
    cell.view.on_health = lambda _: looked.set()
    for _ in range(times):
        looked.clear()
        await looked.wait()
    return cell.view.status()


@asynccontextmanager
async def running(config: CellConfig) -> Any:
    """A cell from when it is ready until it has ended."""
    cell = Cell(config)
    ready = asyncio.Event()
    task = asyncio.create_task(cell.run(ready.set))
    waiting = asyncio.create_task(ready.wait())
    await asyncio.wait((task, waiting), return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    if task.done():
        await task
    try:
        yield cell
    finally:
        cell.stop()
        await task
