"""Recordings that are dropped on the page: taken, refused, drawn, explained, and gone with the page."""

from __future__ import annotations

import asyncio
import errno
import io
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from cellwatt.outlets.page import dropped
from cellwatt.outlets.page.dropped import Drops, items, kind_of
from tests.daemon.outlets.page.cell import client, csrf, get, served
from tests.patience import eventually

CSV = b"t,q_1\n0,1\n"
ECHO = """
import sys, pathlib
words = sys.argv[1:]
print("5 s: looking", file=sys.stderr, flush=True)
if "./bad.csv" in words:
    sys.exit("cellwatt: ./bad.csv: no column q_1")
out = pathlib.Path(words[words.index("--out") + 1])
if words[0] == "plot":
    sys.exit(out.write_text(f"<html>curves of {pathlib.Path(words[1]).read_text()}</html>") == 0)
out.mkdir()
(out / "report.html").write_text("<html>found</html>")
(out / "arm.mended.xml").write_text("<mujoco/>")
print(*words)
"""


@dataclass
class Browser:
    """A browser on a page that takes recordings."""

    session: aiohttp.ClientSession
    root: str
    header: Mapping[str, str]

    async def ask(self, method: str, path: str = "", **more: Any) -> tuple[int, Any]:
        more = {"headers": self.header, **more}
        async with self.session.request(method, f"{self.root}{path}", **more) as response:
            html = response.content_type == "text/html"
            return response.status, await (response.text() if html else response.json())

    async def drop(self, files: Mapping[str, bytes], into: str | None = None) -> str:
        sizes = {path: len(content) for path, content in files.items()}
        status, told = await self.ask("POST", json={"files": sizes, "into": into})
        assert status == 200, told
        for path, content in files.items():
            assert await self.ask("PUT", f"/{told['name']}/files/{path}", data=content) == (200, {})
        return str(told["name"])


@asynccontextmanager
async def browsing(**settings: Any) -> AsyncIterator[Browser]:
    async with served(drops=Drops(), **settings) as page, client() as session:
        yield Browser(session, f"{page.url}/api/recordings", await csrf(session, page.url))


@pytest.fixture
def echo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "echo.py"
    script.write_text(ECHO)
    monkeypatch.setattr(dropped, "COMMANDS", "echo")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where drops are kept."""
    kept = tmp_path / "kept"
    kept.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(kept))
    return kept


def kept(place: Path) -> int:
    """Drops that are on the disk."""
    return len(list(place.iterdir()))


async def test_a_table_is_drawn_and_what_is_no_recording_is_refused_in_words(place: Path, echo: None) -> None:
    async with browsing() as browser:
        name = await browser.drop({"run 1.csv": CSV, "bad.csv": CSV, "echo.py": b"raise SystemExit('dropped and run')"})
        told = (await browser.ask("GET", f"/{name}"))[1]
        kinds = {"bad.csv": "recording", "echo.py": "other", "run 1.csv": "recording"}
        assert {item["path"]: item["kind"] for item in told["items"]} == kinds
        assert await browser.ask("POST", f"/{name}/curves/run%201.csv", json={}) == (200, {})
        drawn = await browser.ask("GET", f"/{name}/curves/run%201.csv")
        assert drawn == (200, f"<html>curves of {CSV.decode()}</html>")
        refused = await browser.ask("POST", f"/{name}/curves/bad.csv", json={})
        assert refused == (409, {"error": "bad.csv: no column q_1"})
        assert (await browser.ask("GET", f"/{name}/curves/bad.csv"))[0] == 404
        await browser.drop({"arm.xml": b"<mujoco/>"}, into=name)
        assert (await browser.ask("GET", f"/{name}/curves/run%201.csv"))[0] == 200
        newer = CSV + b"1,2\n"
        await browser.drop({"run 1.csv": newer}, into=name)  # the same file in a newer state
        assert await browser.ask("POST", f"/{name}/curves/run%201.csv", json={}) == (200, {})
        drawn = await browser.ask("GET", f"/{name}/curves/run%201.csv")
        assert drawn == (200, f"<html>curves of {newer.decode()}</html>")
        assert kept(place) == 1
    assert kept(place) == 0


async def explained(browser: Browser, name: str, chosen: Mapping[str, Any]) -> Any:
    """The answer once explain has ended."""
    assert await browser.ask("POST", f"/{name}/explain", json=chosen) == (200, {})
    return await ended(browser, name)


async def ended(browser: Browser, name: str) -> Any:
    async def look() -> Any:
        found = (await browser.ask("GET", f"/{name}"))[1]["answer"]
        return None if found["running"] else found

    return await eventually(look, "the end of explain")


async def test_explain_gets_what_was_chosen_and_its_files_can_be_had(echo: None) -> None:
    async with browsing() as browser:
        name = await browser.drop({"run.csv": CSV, "bad.csv": CSV})
        assert await browser.drop({"arm.xml": b"<mujoco/>"}, into=name) == name
        chosen = {"recordings": ["run.csv"], "simulations": ["arm.xml"], "robot": None}

        twice = (browser.ask("POST", f"/{name}/explain", json=chosen) for _ in range(2))
        assert sorted(status for status, _ in await asyncio.gather(*twice)) == [200, 409]
        found = await ended(browser, name)
        assert found["said"] == "explain ./run.csv --out result --simulation ./arm.xml --mend ./arm.xml"
        assert (found["error"], found["files"]) == ("", ["arm.mended.xml", "report.html"])
        assert (await browser.ask("GET", f"/{name}/result/report.html"))[1] == "<html>found</html>"
        assert (await browser.ask("GET", f"/{name}/result/..%2Ffiles%2Frun.csv"))[0] == 404
        failed = await explained(browser, name, {**chosen, "recordings": ["bad.csv"]})
        assert failed["error"] == "bad.csv: no column q_1"
        status, refused = await browser.ask("POST", f"/{name}/explain", json={**chosen, "recordings": ["/etc/passwd"]})
        assert (status, refused["error"]) == (409, "/etc/passwd is not among the files that were dropped")


async def test_only_files_that_were_announced_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dropped, "LARGEST", 1000)
    async with browsing() as browser:
        for path in ("../a.csv", "/a.csv", "a/./b.csv", "a\0.csv", "x" * 300):
            assert (await browser.ask("POST", json={"files": {path: 1}}))[0] == 409, path
        assert (await browser.ask("POST", json={"files": {"a.csv": 1001}}))[0] == 409
        assert (await browser.ask("POST", json={"files": {}}))[0] == 409
        assert (await browser.ask("POST", json={"files": {"a.csv": -1}}))[0] == 400
        name = (await browser.ask("POST", json={"files": {"a.csv": 3, "b.csv": 3}}))[1]["name"]
        for path, content in (("c.csv", b"abc"), ("a.csv", b"abcd"), ("b.csv", b"ab"), ("a.csv", b"abc")):
            assert (await browser.ask("PUT", f"/{name}/files/{path}", data=content))[0] == 409, path
        assert (await browser.ask("GET", f"/{name}"))[1]["items"] == []
        assert (await browser.ask("GET", "/7"))[0] == 404
        await browser.drop({"c.csv": CSV}, into=name)
        await browser.ask("POST", json={"files": {"c.csv/d.csv": 1}, "into": name})
        assert (await browser.ask("PUT", f"/{name}/files/c.csv/d.csv", data=b"a"))[0] == 409


class FullDisk(io.BytesIO):
    """A file that takes nothing."""

    def write(self, data: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")


async def test_a_file_that_the_disk_has_no_room_for_is_not_among_the_files(monkeypatch: pytest.MonkeyPatch) -> None:
    def begun(file: Path) -> FullDisk:
        file.touch()
        return FullDisk()

    monkeypatch.setattr(dropped, "_begun", begun)
    async with browsing() as browser:
        name = (await browser.ask("POST", json={"files": {"a.csv": 1}}))[1]["name"]
        assert (await browser.ask("PUT", f"/{name}/files/a.csv", data=b"a"))[0] == 409
        assert (await browser.ask("GET", f"/{name}"))[1]["items"] == []


async def test_what_is_refused_takes_no_place(monkeypatch: pytest.MonkeyPatch, echo: None) -> None:
    """Neither files for which the disk is too small, nor a sample that cannot be made."""
    monkeypatch.setattr(dropped, "KEPT", 1)
    async with browsing() as browser:
        monkeypatch.setattr(dropped, "LARGEST", 1e18)
        status, told = await browser.ask("POST", json={"files": {"a.csv": 10**17}})
        assert status == 409 and "name a larger folder in TMPDIR" in told["error"]
        name = await browser.drop({"a.csv": CSV})
        monkeypatch.setattr(dropped, "SAMPLE", ("./bad.csv",))
        monkeypatch.setattr(dropped, "KEPT", 2)
        assert (await browser.ask("POST", "/sample", json={}))[0] == 409
        assert (await browser.ask("GET"))[1]["drops"] == [name]


async def test_the_oldest_drop_goes(monkeypatch: pytest.MonkeyPatch, place: Path) -> None:
    monkeypatch.setattr(dropped, "KEPT", 2)
    async with browsing() as browser:
        for _ in range(3):
            await browser.drop({"a.csv": CSV})
        assert (await browser.ask("GET"))[1]["drops"] == ["3", "2"]
        assert kept(place) == 2


async def test_others_than_this_pc_and_this_page_drop_nothing() -> None:
    async with browsing() as browser:
        assert (await browser.ask("POST", json={"files": {"a.csv": 1}}, headers={}))[0] == 403
        assert (await browser.ask("PUT", "/1/files/a.csv", data=b"a", headers={}))[0] == 403
    async with browsing(names=("proxy.example",)) as browser:
        assert (await browser.ask("GET"))[0] == 403
        assert (await browser.ask("POST", json={"files": {"a.csv": 1}}))[0] == 403
    async with served() as page, client() as session:
        assert not (await get(session, f"{page.url}/api/site"))["may_drop"]
        await get(session, f"{page.url}/api/recordings", 404)


def test_what_files_are(tmp_path: Path) -> None:
    simulated, beside = {"ARM.URDF": b"<robot>", "arm.xml": b"<mujoco model='a'>"}, {"robot.yaml": b"", "mesh.stl": b""}
    recorded = {
        "RUN.CSV": b"t\n",
        "arm.mjcf": b"<mujoco>",
        "run.bag": b"#ROSBAG V2.0\n",
        "run.xlsx": b"",
        "runs/real_1.csv": b"t\n",
        "runs/sim_1.csv": b"t\n",
        "weld_3.mcap.zst": b"",
    }
    bag = {"bag/metadata.yaml": b"rosbag2_bagfile_information:\n", "bag/bag_0.mcap": b""}
    lerobot = {"set/meta/info.json": b"{}", "set/data/part.parquet": b""}
    for path, content in {**simulated, **beside, **recorded, **bag, **lerobot, "part.xml": b"<mujocoinclude>"}.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes(content)
    found: dict[str, list[str]] = {}
    for path in items(tmp_path):
        found.setdefault(kind_of(path), []).append(str(path.relative_to(tmp_path)))
    assert found == {
        "simulation": ["ARM.URDF", "arm.mjcf", "arm.xml", "runs/sim_1.csv"],
        "recording": ["RUN.CSV", "bag", "run.bag", "run.xlsx", "runs/real_1.csv", "set", "weld_3.mcap.zst"],
        "other": ["mesh.stl", "part.xml"],
        "robot": ["robot.yaml"],
    }


@pytest.mark.slow
async def test_a_sample_is_made_drawn_and_explained_by_the_commands_themselves() -> None:
    pytest.importorskip("mujoco")
    async with browsing() as browser:
        name = (await browser.ask("POST", "/sample", json={}))[1]["name"]
        told = (await browser.ask("GET", f"/{name}"))[1]
        assert "kg" in told["note"] and "spring" in told["note"]
        recordings = [item["path"] for item in told["items"] if item["kind"] == "recording"]
        assert (await browser.ask("POST", f"/{name}/curves/{recordings[0]}", json={}))[0] == 200
        found = await explained(browser, name, {"recordings": recordings, "simulations": ["arm.xml"]})
        assert found["error"] == "" and "Payload: mass" in found["said"] and "Spring load" in found["said"]
        assert {"report.html", "arm.mended.xml"} <= set(found["files"])
