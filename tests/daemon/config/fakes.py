"""Drivers, stages and outlets that exist only for these tests, found through entry points like any other."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, FilePath, SecretStr, field_validator, model_validator

from cellwatt import (
    Channel,
    Driver,
    Identity,
    Layout,
    ModelError,
    Outlet,
    OutletSettings,
    SourceSettings,
    Stage,
    StageSettings,
    Stream,
)
from cellwatt.frames import Frames
from cellwatt.quantity import Bytes, Fraction, Hertz, Radians, Seconds, Watts
from cellwatt.results import Result
from cellwatt.stage import CellInfo

MODULE = "tests.daemon.config.fakes"


class Limits(BaseModel):
    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True)

    power: Watts = 1500.0
    """Largest power."""
    angle: Radians = 0.1
    """Largest angle."""


class ArmSettings(SourceSettings):
    """An arm on the network."""

    host: str
    """Address of the controller. A name works too."""
    port: int = Field(30004, ge=1, le=65535)
    """TCP port."""
    rate: Hertz = 500.0
    """Samples a second."""
    client: Literal["native", "library"] = "native"
    """Who speaks the protocol."""
    joints: list[int] = Field([1, 2, 3])
    """Joints to read."""
    gains: dict[int, float] = Field({})
    """Factor per joint."""
    limits: Limits = Limits()
    """What is too much."""
    zones: dict[str, Limits] = Field({})
    """Limits by zone."""
    verify: bool = True
    """Compare the identity."""
    payload: float = Field(0.0, ge=0)
    """Mass at the flange, kg."""
    user: str | None = None
    password: SecretStr | None = None
    note: str = ""
    box: int | bool = 0

    @field_validator("joints")
    @classmethod
    def _once(cls, joints: list[int]) -> list[int]:
        if len(set(joints)) != len(joints):
            raise ValueError("each joint may be named once only")
        return joints

    @model_validator(mode="after")
    def _both(self) -> ArmSettings:
        if (self.user is None) != (self.password is None):
            raise ValueError("user and password go together: give both or none")
        return self


class ArmDriver(Driver[ArmSettings]):
    """Reads the arm of the tests."""

    Settings = ArmSettings
    title = "Arm of the tests"
    emulator = f"{MODULE}:None"
    writes = ("a greeting",)

    @property
    def streams(self) -> tuple[Stream, ...]:
        channels = tuple(Channel(f"joint_{j}.position", "rad") for j in self.settings.joints)
        return (Stream("state", (*channels, Channel("supply.power", "W")), self.settings.rate, "device"),)

    async def run(self) -> None:
        raise AssertionError("these tests never connect")

    async def identify(self) -> Identity:
        raise AssertionError("these tests never connect")


class MeterSettings(SourceSettings):
    """A meter on a serial port."""

    port: str
    """Device path."""
    baud: int = 115200
    """Speed."""
    unit: str = "W"
    twice: bool = False


class MeterDriver(ArmDriver):
    """Reads the meter of the tests."""

    Settings = MeterSettings  # type: ignore[assignment]
    title = "Meter of the tests"
    writes = ()

    @property
    def streams(self) -> tuple[Stream, ...]:
        settings: Any = self.settings
        channel = Channel("bus.power", settings.unit)
        return (Stream("power", (channel,) * (2 if settings.twice else 1), 0.0, "host"),)


class CutSettings(StageSettings):
    """Cuts."""

    hold: Seconds = 0.2
    """Shortest interval."""


class CutStage(Stage[CutSettings]):
    """Cuts frames."""

    Settings = CutSettings
    title = "Cutter of the tests"

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        return ()


class WatchSettings(StageSettings):
    """Watches."""

    tolerance: Fraction = 0.1
    """Largest deviation."""
    memory: Bytes = 1e6
    """Room for the history."""


class WatchStage(CutStage):
    """Watches what was cut."""

    Settings = WatchSettings  # type: ignore[assignment]
    title = "Watcher of the tests"
    needs: ClassVar[tuple[str, ...]] = ("cut",)


class NetSettings(StageSettings):
    """A model."""

    file: FilePath
    """The model."""
    folder: Path | None = None
    """Where to leave notes."""
    input: str = "supply.power"


class NetStage(CutStage):
    """A model of the tests; its file holds the name of the robot that it is of."""

    Settings = NetSettings  # type: ignore[assignment]
    title = "Model of the tests"

    def __init__(self, name: str, settings: Any, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        robot = (cell.folder / settings.file).read_text().strip()
        if robot != cell.robot:
            raise ModelError(f"the model is of the robot {robot!r}, the cell has {cell.robot!r}")
        layout.index(settings.input)


class BusSettings(OutletSettings):
    """A bus."""

    connect: list[str] = Field([])
    """Routers."""
    mode: Literal["peer", "client"] = "peer"


class BusOutlet(Outlet[BusSettings]):
    """The bus of the tests."""

    Settings = BusSettings
    title = "Bus of the tests"

    def offer(self, item: object) -> None:
        raise AssertionError("these tests publish nothing")

    def health(self, status: object) -> None:
        raise AssertionError("these tests publish nothing")

    async def run(self) -> None:
        raise AssertionError("these tests publish nothing")


POINTS = [
    EntryPoint(name, f"{MODULE}:{value}", f"cellwatt.{group}")
    for group, name, value in (
        ("drivers", "arm", "ArmDriver"),
        ("drivers", "meter", "MeterDriver"),
        ("drivers", "broken", "NoSuchDriver"),
        ("stages", "cut", "CutStage"),
        ("stages", "watch", "WatchStage"),
        ("stages", "net", "NetStage"),
        ("outlets", "zenoh", "BusOutlet"),
        ("outlets", "log", "BusOutlet"),
    )
] + [EntryPoint("absent", "no_such_package_anywhere:Driver", "cellwatt.drivers")]


def entry_points(group: str) -> list[EntryPoint]:
    """Stands for ``importlib.metadata.entry_points``."""
    return [p for p in POINTS if p.group == group]
