"""Recordings dropped on the page: stored while it is served, and drawn and explained by cellwatt's commands."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal

from aiohttp import web

from cellwatt.child import output
from cellwatt.door.http import BODY
from cellwatt.errors import CellwattError
from cellwatt.outlets.page.api import body_of, report_page
from cellwatt.outlets.page.gate import answer

LARGEST: Final = 4_000_000_000
"""Largest size, bytes, of the files of one request."""
MOST_FILES: Final = 200
KEPT: Final = 8
"""Largest number of stored drops; the oldest is removed."""
LONGEST_PATH: Final = 200
LIMIT: Final = 900.0
"""Longest run time, s, of a command."""
NICENESS: Final = 10
COMMANDS: Final = "cellwatt.commands"
SAMPLE: Final = ("--conceal", "payload", "--conceal", "spring")
ROOT: Final = "/api/recordings"
DROP: Final = f"{ROOT}/{{name:\\d+}}"
AT_ONCE: Final = 2
"""Number of commands that run concurrently; further ones wait."""
_SIMULATORS: Final = (".xml", ".mjcf", ".urdf")
_TABLES: Final = (
    ".csv", ".tsv", ".txt", ".dat", ".log", ".parquet", ".mcap", ".db3", ".gz", ".xls", ".xlsx", ".ods", ".zip", ".bag",
    ".mat", ".h5", ".hdf5", ".npy", ".npz",
)  # fmt: skip
"""Endings of recordings, and of what is refused as one with advice."""
_HEAD: Final = 65_536

Kind = Literal["recording", "simulation", "robot", "other"]


@dataclass
class Explanation:
    """Progress and result of ``explain`` for a drop."""

    running: bool = True
    said: str = ""
    """Progress while running, then the output of the command."""
    error: str = ""


@dataclass
class Drop:
    """The files of one drop, below ``folder``."""

    name: str
    folder: Path
    awaited: dict[str, int]
    """Size, bytes, of each announced file that has not arrived, by path."""
    note: str = ""
    """Description of the physics concealed in a sample."""
    answer: Explanation | None = None
    drawn: dict[str, Path] = field(default_factory=dict)
    """Pages of curves, by the path of the recording."""
    numbers: Iterator[int] = field(default_factory=count)

    @property
    def files(self) -> Path:
        """Folder of the dropped files."""
        return self.folder / "files"

    @property
    def result(self) -> Path:
        """Output folder of ``explain``."""
        return self.folder / "result"

    def describe(self) -> dict[str, Any]:
        """Description of the drop, ready for JSON; reads the disk."""
        found = [{"path": str(p.relative_to(self.files)), "kind": kind_of(p)} for p in items(self.files)]
        made = sorted(p.name for p in self.result.glob("*")) if self.answer and not self.answer.running else []
        answer = None if self.answer is None else {**vars(self.answer), "files": made}
        return {"name": self.name, "items": found, "note": self.note, "answer": answer}


class Drops:
    """All drops of a page and their HTTP API; ``close`` removes them."""

    def __init__(self) -> None:
        self._drops: dict[str, Drop] = {}
        self._numbers = count(1)
        self._turn = asyncio.Semaphore(AT_ONCE)
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def routes(self, may: Callable[[web.Request], bool]) -> Sequence[web.AbstractRouteDef]:
        """Routes below ``ROOT``; ``may`` is True for requests of visitors who may drop recordings."""
        self._may = may
        return (
            web.get(ROOT, self._all),
            web.post(ROOT, self._open),
            web.post(f"{ROOT}/sample", self._sample),
            web.get(DROP, self._one),
            web.put(f"{DROP}/files/{{path:.+}}", self.put),
            web.post(f"{DROP}/curves/{{path:.+}}", self._draw),
            web.get(f"{DROP}/curves/{{path:.+}}", self._curves),
            web.post(f"{DROP}/explain", self._explain),
            web.get(f"{DROP}/result/{{file}}", self._result),
        )

    def _checked(self, request: web.Request) -> None:
        if not self._may(request):
            raise web.HTTPForbidden(text="only users who may act can drop recordings, on a page served to this PC only")

    def _drop(self, request: web.Request) -> Drop:
        self._checked(request)
        try:
            return self._drops[request.match_info["name"]]
        except KeyError:
            raise web.HTTPNotFound(text="these recordings are no longer stored: drop them again") from None

    async def _all(self, request: web.Request) -> web.StreamResponse:
        self._checked(request)
        return answer({"drops": list(reversed(self._drops))})

    async def _one(self, request: web.Request) -> web.StreamResponse:
        return answer(await asyncio.to_thread(self._drop(request).describe))

    # files ----------------------------------------------------------------------------------------

    async def _open(self, request: web.Request) -> web.StreamResponse:
        """Announce files with their sizes, for a new or an existing drop. Raises ``CellwattError``."""
        self._checked(request)
        body = await body_of(request)
        files, into = body.get("files"), body.get("into")
        if not isinstance(files, dict) or not all(isinstance(n, int) and n >= 0 for n in files.values()):
            raise web.HTTPBadRequest(text="files: expected a size in bytes for each path")
        if not 0 < len(files) <= MOST_FILES:
            raise CellwattError(f"{len(files)} files were dropped: 1 to {MOST_FILES} can be opened at a time")
        for path in files:
            _check(path)
        if (size := sum(files.values())) > LARGEST:
            most = f"the maximum is {LARGEST / 1e9:.0f} GB"
            raise CellwattError(f"{size / 1e9:.1f} GB were dropped, {most}: use cellwatt plot")
        folder = await asyncio.to_thread(tempfile.gettempdir)
        if (free := (await asyncio.to_thread(shutil.disk_usage, folder)).free) < 2 * size:
            raise CellwattError(f"{folder} has {free / 1e9:.1f} GB free: name a larger folder in TMPDIR")
        known = self._drops.get(into) if isinstance(into, str) else None
        drop = known or await self._new()
        drop.awaited.update(files)
        return answer({"name": drop.name})

    async def _new(self) -> Drop:
        name = str(next(self._numbers))
        folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix="cellwatt-view-"))
        self._drops[name] = drop = Drop(name, folder, {})
        await asyncio.to_thread(drop.files.mkdir)
        while len(self._drops) > KEPT:
            await self._remove(self._drops.pop(next(iter(self._drops))))
        return drop

    async def _remove(self, drop: Drop) -> None:
        """End the command that runs for a drop, and remove its files."""
        if (task := self._tasks.pop(drop.name, None)) is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)  # else it writes into the folder that is removed
        await asyncio.to_thread(shutil.rmtree, drop.folder, ignore_errors=True)

    async def put(self, request: web.Request) -> web.StreamResponse:
        """Receive one file in pieces; the door does not read the body of this request.

        Raises ``CellwattError`` if the file was not announced or has another size.
        """
        drop, path = self._drop(request), request.match_info["path"]
        size = drop.awaited.pop(path, None)
        if size is None:
            raise CellwattError(f"{path:.200} was not announced: drop it again")
        file, remaining, whole = drop.files / path, size, False
        for drawn in [each for each in drop.drawn if f"{path}/".startswith(f"{each}/")]:
            del drop.drawn[drawn]  # drawn from an older version of the file, or of the bag that contains it
        try:
            with await asyncio.to_thread(_begun, file) as out:
                async for piece in _pieces(request):
                    if (remaining := remaining - len(piece)) < 0:
                        break
                    await asyncio.to_thread(out.write, piece)
            whole = not remaining
        except OSError as error:
            raise CellwattError(f"{path:.200} cannot be stored: {error.strerror}") from None
        finally:
            if not whole:
                with contextlib.suppress(OSError):  # a folder may have its name
                    await asyncio.to_thread(file.unlink)
        if remaining:
            raise CellwattError(f"{path:.200} has another size than was announced: drop it again")
        return answer({})

    # commands -------------------------------------------------------------------------------------

    async def _draw(self, request: web.Request) -> web.StreamResponse:
        drop, path = self._drop(request), request.match_info["path"]
        if path not in drop.drawn:
            await asyncio.to_thread(_known, drop, [path])
            out = drop.folder / f"curves-{next(drop.numbers)}.html"
            await self._run(drop, ["plot", f"./{path}", "--out", str(out)])
            drop.drawn[path] = out
        return answer({})

    async def _curves(self, request: web.Request) -> web.StreamResponse:
        drawn = self._drop(request).drawn.get(request.match_info["path"])
        if drawn is None:
            raise web.HTTPNotFound(text="this recording is not drawn")
        return report_page(drawn)

    async def _sample(self, request: web.Request) -> web.StreamResponse:
        """Create a sample drop: a simulation of an arm and two recordings with physics that the simulation lacks."""
        self._checked(request)
        drop = await self._new()
        try:
            drop.note = await self._run(drop, ["demo", "explain", "--only-files", *SAMPLE, "--out", "."])
        except CellwattError:
            await self._remove(self._drops.pop(drop.name, drop))
            raise
        return answer({"name": drop.name})

    async def _explain(self, request: web.Request) -> web.StreamResponse:
        drop, body = self._drop(request), await body_of(request)
        recordings, simulations = _paths(body, "recordings"), _paths(body, "simulations")
        robot = str(body.get("robot") or "")
        if not recordings:
            raise CellwattError("no recording is chosen")
        await asyncio.to_thread(_known, drop, [*recordings, *simulations, *([robot] if robot else [])])
        if drop.answer is not None and drop.answer.running:  # no await between this check and the start
            raise CellwattError("these recordings are being explained already")
        words = ["explain", *(f"./{path}" for path in recordings), "--out", str(drop.result)]
        words += ["--simulation", *(f"./{path}" for path in simulations)] if simulations else []
        words += ["--robot", f"./{robot}"] if robot else []
        own = [path for path in simulations if Path(path).suffix.lower() in _SIMULATORS]
        words += ["--mend", f"./{own[0]}"] if own else []
        drop.answer = explanation = Explanation()
        self._tasks[drop.name] = asyncio.create_task(self._explained(drop, explanation, words))
        return answer({})

    async def _explained(self, drop: Drop, explanation: Explanation, words: list[str]) -> None:
        def progress(line: str) -> None:
            explanation.said = line

        try:
            await asyncio.to_thread(shutil.rmtree, drop.result, ignore_errors=True)
            explanation.said = (await self._run(drop, words, progress)).replace(f"{drop.folder}/", "")
        except CellwattError as error:
            explanation.said, explanation.error = "", str(error)
        finally:
            explanation.running = False

    async def _result(self, request: web.Request) -> web.StreamResponse:
        drop, name = self._drop(request), request.match_info["file"]
        made = await asyncio.to_thread(lambda: {path.name: path for path in drop.result.glob("*")})
        if (file := made.get(name)) is None:
            raise web.HTTPNotFound(text="there is no such file")
        if file.suffix == ".html":
            return report_page(file)
        headers = {"Content-Disposition": "attachment", "Content-Type": "application/octet-stream"}
        return web.FileResponse(file, headers=headers)

    async def _run(self, drop: Drop, words: Sequence[str], heard: Callable[[str], object] = len) -> str:
        """Output of a command run in the drop's folder. Raises ``CellwattError`` if it fails."""
        async with self._turn:
            try:
                return await output([COMMANDS, *words], LIMIT, NICENESS, folder=drop.files, heard=heard)
            except CellwattError as error:
                raise CellwattError(str(error).replace("./", "")) from None

    async def close(self) -> None:
        """Cancel running commands and remove all files."""
        for drop in list(self._drops.values()):
            await self._remove(drop)


def items(folder: Path) -> list[Path]:
    """Files in a folder and its subfolders, sorted; a bag or a LeRobot data set counts as one file."""
    from cellwatt.logs import bag, lerobot

    found: list[Path] = []
    for path in sorted(folder.iterdir()):
        whole = path.is_file() or bag.is_bag(path) or lerobot.root_of(path) == path
        found += [path] if whole else items(path)
    return found


def kind_of(path: Path) -> Kind:
    """Likely kind of a dropped file."""
    ending = path.suffix.lower()
    if ending in _SIMULATORS:
        with path.open("rb") as file:
            head = file.read(_HEAD)
        return "simulation" if b"<mujoco" in head.replace(b"<mujocoinclude", b"") or b"<robot" in head else "other"
    if path.name == "robot.yaml":
        return "robot"
    if path.is_dir() or ending in _TABLES or ".mcap" in path.suffixes:
        return "simulation" if path.name.startswith("sim") else "recording"
    return "other"


def _begun(file: Path) -> BinaryIO:
    file.parent.mkdir(parents=True, exist_ok=True)
    return file.open("wb")


def _check(path: str) -> None:
    parts = path.split("/")
    if len(path.encode()) > LONGEST_PATH or not path.isprintable() or any(part in ("", ".", "..") for part in parts):
        raise CellwattError(f"{path!r:.220} cannot be stored: give it a shorter, plain name")


def _known(drop: Drop, paths: Sequence[str]) -> None:
    """Raise ``CellwattError`` unless all announced files have arrived and ``paths`` are among them."""
    if drop.awaited:
        raise CellwattError(f"{next(iter(drop.awaited)):.200} has not arrived: drop it again")
    present = {str(item.relative_to(drop.files)) for item in items(drop.files)}
    for path in paths:
        if path not in present:
            raise CellwattError(f"{path:.200} is not among the files that were dropped")


def _paths(body: Any, name: str) -> list[str]:
    found = body.get(name)
    if not isinstance(found, list) or not all(isinstance(path, str) for path in found):
        raise web.HTTPBadRequest(text=f"{name}: expected paths of files that were dropped")
    return found


async def _pieces(request: web.Request) -> AsyncIterator[bytes]:
    """Yield the body of a request as it arrives. Raises ``CellwattError`` if it breaks off."""
    piece = b"first"
    while piece:
        try:
            async with asyncio.timeout(BODY):
                piece = await request.content.readany()
        except (TimeoutError, OSError, web.HTTPException) as error:
            raise CellwattError("the transfer of the file broke off: drop it again") from error
        yield piece
