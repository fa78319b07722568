"""Recordings that are dropped on the page: kept while it is served, drawn and explained by cellwatt's commands."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal

from cellwatt.child import output
from cellwatt.errors import CellwattError

LARGEST: Final = 4_000_000_000
"""Bytes of one drop."""
MOST_FILES: Final = 200
KEPT: Final = 8
"""Drops; the oldest goes."""
LONGEST_PATH: Final = 200
LIMIT: Final = 900.0
"""s that a command may take."""
NICENESS: Final = 10
COMMANDS: Final = "cellwatt.commands"
SAMPLE: Final = ("--conceal", "payload", "--conceal", "spring")
AT_ONCE: Final = 2
"""Commands; more wait."""
_TABLES: Final = (".csv", ".tsv", ".txt", ".dat", ".parquet", ".mcap", ".db3")
_HEAD: Final = 65_536

Kind = Literal["recording", "simulation", "robot", "other"]


@dataclass
class Answer:
    """What ``explain`` says of a drop, while it works and afterwards."""

    running: bool = True
    said: str = ""
    """Progress, and in the end what the terminal would show."""
    error: str = ""


@dataclass
class Drop:
    """Files of one drop, below ``folder``."""

    name: str
    folder: Path
    awaited: dict[str, int]
    """Bytes of each file that is still to come, by its path."""
    note: str = ""
    """What a sample conceals."""
    answer: Answer | None = None
    drawn: dict[str, Path] = field(default_factory=dict)
    """Pages of curves, by the path of what was drawn."""
    numbers: Iterator[int] = field(default_factory=count)

    @property
    def files(self) -> Path:
        """Where the files are."""
        return self.folder / "files"

    @property
    def result(self) -> Path:
        """Where ``explain`` writes."""
        return self.folder / "result"

    def told(self) -> dict[str, Any]:
        """The drop, JSON-ready; reads the disk."""
        found = [{"path": str(p.relative_to(self.files)), "kind": kind_of(p)} for p in items(self.files)]
        made = sorted(p.name for p in self.result.glob("*")) if self.answer and not self.answer.running else []
        answer = None if self.answer is None else {**vars(self.answer), "files": made}
        return {"name": self.name, "items": found, "note": self.note, "answer": answer}


class Drops:
    """All drops of a page; ``close`` removes them."""

    def __init__(self) -> None:
        self._drops: dict[str, Drop] = {}
        self._made = 0
        self._turn = asyncio.Semaphore(AT_ONCE)
        self._tasks: dict[str, asyncio.Task[None]] = {}

    @property
    def names(self) -> list[str]:
        """Names of the drops, the newest first."""
        return list(reversed(self._drops))

    def __getitem__(self, name: str) -> Drop:
        return self._drops[name]

    async def open(self, files: Mapping[str, int], into: Drop | None = None) -> Drop:
        """A drop that awaits files of some bytes by their paths. Raises ``CellwattError`` where they do not fit."""
        if not 0 < len(files) <= MOST_FILES:
            raise CellwattError(f"{len(files)} files were dropped: 1 to {MOST_FILES} can be opened at a time")
        for path in files:
            _check(path)
        if (size := sum(files.values())) > LARGEST:
            raise CellwattError(
                f"{size / 1e9:.1f} GB were dropped, {LARGEST / 1e9:.0f} GB are the most: use cellwatt plot"
            )
        drop = into or await self._new()
        if (free := (await asyncio.to_thread(shutil.disk_usage, drop.files)).free) < 2 * size:
            raise CellwattError(f"{drop.files} has {free / 1e9:.1f} GB left: name a larger folder in TMPDIR")
        drop.awaited.update(files)
        return drop

    async def _new(self) -> Drop:
        self._made += 1
        name = str(self._made)
        folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix="cellwatt-view-"))
        self._drops[name] = drop = Drop(name, folder, {})
        await asyncio.to_thread(drop.files.mkdir)
        for old in list(self._drops.values())[:-KEPT]:
            del self._drops[old.name]
            if (task := self._tasks.pop(old.name, None)) is not None:
                task.cancel()
            await asyncio.to_thread(shutil.rmtree, old.folder, ignore_errors=True)
        return drop

    async def take(self, drop: Drop, path: str, content: AsyncIterator[bytes]) -> None:
        """Write one file. Raises ``CellwattError`` where it was not announced, or has another size."""
        size = drop.awaited.pop(path, None)
        if size is None:
            raise CellwattError(f"{path:.200} was not announced: drop it again")
        file, left = drop.files / path, size
        for drawn in [each for each in drop.drawn if f"{path}/".startswith(f"{each}/")]:
            del drop.drawn[drawn]  # of an older state of the file, or of the bag that it is in
        try:
            out = await asyncio.to_thread(_begun, file)
            try:
                async for piece in content:
                    if (left := left - len(piece)) < 0:
                        break
                    await asyncio.to_thread(out.write, piece)
            finally:
                await asyncio.to_thread(out.close)
        except OSError as error:
            raise CellwattError(f"{path:.200} cannot be kept: {error.strerror}") from None
        finally:
            if left:
                await asyncio.to_thread(file.unlink, missing_ok=True)
        if left:
            raise CellwattError(f"{path:.200} has another size than was announced: drop it again")

    async def draw(self, drop: Drop, path: str) -> None:
        """Make the page of a recording's curves. Raises ``CellwattError`` where it cannot be drawn."""
        if path not in drop.drawn:
            await asyncio.to_thread(_known, drop, [path])
            out = drop.folder / f"curves-{next(drop.numbers)}.html"
            await self._run(drop, ["plot", f"./{path}", "--out", str(out)])
            drop.drawn[path] = out

    async def sample(self) -> Drop:
        """A drop of an arm's simulation and two recordings of it, with physics concealed. Raises ``CellwattError``."""
        drop = await self.open({"arm.xml": 0})
        drop.awaited.clear()
        drop.note = await self._run(drop, ["demo", "explain", "--only-files", *SAMPLE, "--out", "."])
        return drop

    async def explain(self, drop: Drop, recordings: Sequence[str], simulations: Sequence[str], robot: str) -> None:
        """Begin to explain. Raises ``CellwattError`` where that cannot be."""
        if drop.answer is not None and drop.answer.running:
            raise CellwattError("these recordings are being explained already")
        if not recordings:
            raise CellwattError("no recording is chosen")
        await asyncio.to_thread(_known, drop, [*recordings, *simulations, *([robot] if robot else [])])
        words = ["explain", *(f"./{path}" for path in recordings), "--out", str(drop.result)]
        words += ["--simulation", *(f"./{path}" for path in simulations)] if simulations else []
        words += ["--robot", f"./{robot}"] if robot else []
        own = [path for path in simulations if Path(path).suffix in (".xml", ".urdf")]
        words += ["--mend", f"./{own[0]}"] if own else []
        await asyncio.to_thread(shutil.rmtree, drop.result, ignore_errors=True)
        drop.answer = answer = Answer()
        self._tasks[drop.name] = asyncio.create_task(self._explained(drop, answer, words))

    async def _explained(self, drop: Drop, answer: Answer, words: list[str]) -> None:
        def progress(line: str) -> None:
            answer.said = line

        try:
            answer.said = (await self._run(drop, words, progress)).replace(f"{drop.folder}/", "")
        except CellwattError as error:
            answer.said, answer.error = "", str(error)
        finally:
            answer.running = False

    async def _run(self, drop: Drop, words: Sequence[str], heard: Callable[[str], object] = len) -> str:
        """Output of a command in the drop's folder. Raises ``CellwattError`` where it fails."""
        async with self._turn:
            try:
                return await output([COMMANDS, *words], LIMIT, NICENESS, folder=drop.files, heard=heard)
            except CellwattError as error:
                raise CellwattError(str(error).replace("./", "")) from None

    async def close(self) -> None:
        """End what is being done, and remove all files."""
        for task in self._tasks.values():
            task.cancel()
        await asyncio.gather(*self._tasks.values(), return_exceptions=True)
        for drop in self._drops.values():
            await asyncio.to_thread(shutil.rmtree, drop.folder, ignore_errors=True)


def items(folder: Path) -> list[Path]:
    """Files in a folder and below it; a bag and a LeRobot data set are one each. Sorted."""
    from cellwatt.logs import bag, lerobot

    found: list[Path] = []
    for path in sorted(folder.iterdir()):
        whole = path.is_file() or bag.is_bag(path) or lerobot.root_of(path) == path
        found += [path] if whole else items(path)
    return found


def kind_of(path: Path) -> Kind:
    """What a file of a drop is likely to be."""
    if path.suffix in (".xml", ".urdf"):
        with path.open("rb") as file:
            head = file.read(_HEAD)
        return "simulation" if b"<mujoco" in head.replace(b"<mujocoinclude", b"") or b"<robot" in head else "other"
    if path.name == "robot.yaml":
        return "robot"
    if path.is_dir() or path.suffix in _TABLES or ".mcap" in path.suffixes:
        return "simulation" if path.name.startswith("sim") else "recording"
    return "other"


def _begun(file: Path) -> BinaryIO:
    file.parent.mkdir(parents=True, exist_ok=True)
    return file.open("wb")


def _check(path: str) -> None:
    parts = path.split("/")
    if len(path.encode()) > LONGEST_PATH or not path.isprintable() or any(part in ("", ".", "..") for part in parts):
        raise CellwattError(f"{path!r:.220} cannot be kept: give it a shorter, plain name")


def _known(drop: Drop, paths: Sequence[str]) -> None:
    """Raise ``CellwattError`` unless all files are there, and these among them."""
    if drop.awaited:
        raise CellwattError(f"{next(iter(drop.awaited)):.200} has not arrived: drop it again")
    there = {str(item.relative_to(drop.files)) for item in items(drop.files)}
    for path in paths:
        if path not in there:
            raise CellwattError(f"{path:.200} is not among the files that were dropped")
