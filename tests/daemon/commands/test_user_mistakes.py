"""Mistakes at the command line and in files: an exit code and a line that says what to do, never a traceback."""

from __future__ import annotations

import io
import resource
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from unittest.mock import Mock

import pytest

from cellwatt import registry
from cellwatt.channel import Channel, Stream
from cellwatt.errors import RecordingError
from cellwatt.record import Recording
from cellwatt.results import Interval
from tests.daemon.commands.calling import CELL, Call, call, cell, points_with
from tests.daemon.conftest import Registered
from tests.daemon.record import making
from tests.rights import as_anybody

__all__ = ["call", "cell"]

USAGE, ERROR, BUG = 2, 3, 70
REST = Interval("arm", 1, making.SESSION, making.SESSION + 20_000_000, (), (0.0,), (0.0,), (0.0,))
CONNECT = ("--site", "plant", "--cell", "weld", "--connect")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a right file and several wrong ones."""
    place = tmp_path_factory.mktemp("mistakes")
    (place / "empty").mkdir()
    (place / "weld.yaml").write_text(CELL)
    (place / "bad.yaml").write_text("site: [\n")
    (place / "unknown.yaml").write_text(CELL.replace("fake", "fakes"))
    (place / "off.yaml").write_text(CELL + "zenoh: off\n")
    (place / "silent.yaml").write_text(CELL + "zenoh: {}\n")
    (place / "nonsense.mcap").write_bytes(b"nonsense" * 100)
    (place / "untimed.csv").write_text("a,b\n1,2\n")
    (place / "recordings").mkdir()
    chunk = [making.batch_of(0, 15), making.frames_of(0, 10), REST]
    making.write_chunks(place / "recordings", [chunk], header=making.weld(""))
    return place


FILES = ("run", "check", "doctor", "record", "watch")


WRONG = {
    "absent.yaml": "absent.yaml: cannot be read: no such file or directory",
    "empty": "empty: cannot be read: is a directory",
    "bad.yaml": "bad.yaml:2:1: not valid YAML",
    "unknown.yaml": "unknown.yaml:4:17: sources.arm.driver: no driver named 'fakes'; did you mean 'fake'?",
}


@pytest.mark.parametrize("command", FILES)
def test_a_settings_file_that_is_wrong(call: Call, place: Path, command: str) -> None:
    for file, words in WRONG.items():
        ended = call(command, place / file)
        assert ended.code == USAGE, file
        assert words in ended.out + ended.err
        assert (ended.out + ended.err).count("\n") == 1


MISTAKES = [
    # nothing and unknown things
    (("rn",), USAGE, "No such command 'rn'"),
    (("run",), USAGE, "Missing argument 'FILE'"),
    (("export", "recordings"), USAGE, "Missing option '--out'"),
    (("emulate", "skeletn"), USAGE, "no driver named 'skeletn'; did you mean 'skeleton'?"),
    # places that are not there
    (("replay", "absent"), USAGE, "'absent' does not exist"),
    (("replay", "empty"), ERROR, "cellwatt: empty: no recordings (*.mcap) there"),
    (("replay", "nonsense.mcap"), ERROR, "nonsense.mcap: holds no data of a recording"),
    (("replay", "recordings", "--settings", "absent.yaml"), USAGE, "absent.yaml: cannot be read"),
    # places that cannot be written
    (("export", "recordings", "--out", "weld.yaml/out"), ERROR, "weld.yaml/out cannot be created: Not a directory"),
    # numbers that are none, too long names, things of another kind
    (("record", "weld.yaml", "--seconds", "nan"), USAGE, "found 'nan', expected a finite number"),
    (("record", "weld.yaml", "--seconds", "-1"), USAGE, "-1.0 is not in the range x>=0"),
    (("secure", "init", "x" * 300, "--site", "plant"), ERROR, "File name too long"),
    (("export", "recordings", "--out", "\udcff"), ERROR, "cannot be written: its name is not UTF-8"),
    (("simulate", "--model", "bad.yaml", "--motion", "untimed.csv", "--out", "o"), USAGE, "not valid YAML"),
    (("plot", "recordings", "--channel", "torque"), ERROR, "nothing to draw: no such channels"),
    (("view", "untimed.csv"), USAGE, "untimed.csv is no settings file: draw it with cellwatt plot, or drop it on"),
    (("watch", "weld.yaml", "--cell", "other"), USAGE, "--site and --cell name the cell of --connect, not that of"),
    (("view", "weld.yaml", "--foxglove", "--arm", "arm=a.urdf"), USAGE, "--page and --arm are for browsers, not for"),
    (("watch", "off.yaml"), USAGE, "not on the bus: zenoh is off; or use --connect"),
    (("health", "off.yaml"), USAGE, "zenoh is off; set zenoh: {listen: [tcp/127.0.0.1:7447]}, or ask the outlet"),
    (("health", "silent.yaml"), USAGE, "zenoh has neither listen nor connect; set zenoh: {listen: [tcp/127.0.0.1:"),
    (("watch", *CONNECT, "192.0.2.1"), USAGE, "'192.0.2.1' is not an endpoint; expected protocol/host:port, like"),
    (("watch", *CONNECT, "tls/192.0.2.1:7447"), USAGE, "tls/192.0.2.1:7447 needs --ca FILE, and --certificate and"),
    (("demo", "--seconds", "3"), USAGE, "at least 20 s are needed"),
    (("emulate", "skeleton", "--recording", "untimed.csv"), ERROR, "no column t, timestamp or time for the time"),
    (("emulate", "skeleton", "--loop"), USAGE, "--loop goes with --recording FILE"),
    (("emulate", "skeleton", "--recording", "untimed.csv", "--speed", "2"), USAGE, "--speed is that of the built-in"),
    (("emulate", "skeleton", "--speed", "0"), USAGE, "0.0 is not in the range x>0"),
    (("emulate", "skeleton", "--option", "noise"), USAGE, "found 'noise' as an option, expected KEY=VALUE"),
    (("emulate", "skeleton", "--listen", "everywhere"), USAGE, "the address is HOST:PORT"),
    (("emulate", "skeleton", "--listen", "192.0.2.1:1"), ERROR, "annot assign requested address"),
]


def test_each_mistake_is_told_in_its_words(call: Call, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    for arguments, code, words in MISTAKES:
        ended = call(*arguments)
        assert (ended.code, ended.out) == (code, ""), (arguments, ended)
        assert words in " ".join(ended.err.split()), (arguments, ended.err)


@pytest.fixture
def forbidden(tmp_path: Path) -> Iterator[Path]:
    """A folder that may not be written, with a file that may not be read, for root neither."""
    (tmp_path / "weld.yaml").write_text(CELL)
    (tmp_path / "weld.yaml").chmod(0)
    (tmp_path / "open.yaml").write_text(CELL + "record: {folder: recordings}\n")
    (tmp_path / "closed").mkdir(0)
    tmp_path.chmod(0o555)
    with as_anybody():
        yield tmp_path
    tmp_path.chmod(0o755)
    (tmp_path / "closed").chmod(0o755)


def test_what_may_not_be_read_or_made(call: Call, forbidden: Path) -> None:
    ended = call("check", forbidden / "weld.yaml")
    told = f"{forbidden / 'weld.yaml'}: cannot be read: permission denied\n"
    assert (ended.code, ended.out + ended.err) == (USAGE, told)
    ended = call("run", forbidden / "open.yaml")
    assert ended.code == ERROR
    assert f"record.folder {forbidden / 'recordings'} cannot be created: Permission denied" in ended.err
    hidden = forbidden / "closed" / "run.mcap"
    ended = call("plot", hidden)
    assert (ended.code, ended.err) == (ERROR, f"cellwatt: {hidden} cannot be opened: Permission denied\n")


@pytest.fixture
def lacking(call: Call, registered: Registered) -> Call:
    """``cellwatt`` with a command whose package is not installed."""
    gone = EntryPoint("gone", "package_that_is_not_there:command", "cellwatt.commands")
    registered(points_with(gone))
    return call


def test_a_command_whose_package_is_missing_and_the_help_of_the_others(lacking: Call) -> None:
    ended = lacking("gone", "a", "--out", "b")
    assert ended.code == USAGE
    assert ended.err == (
        "command 'gone' cannot be loaded: ModuleNotFoundError: No module named 'package_that_is_not_there'\n"
    )
    ended = lacking("--help")
    assert (ended.code, ended.err) == (0, "")
    assert "Check settings files; connects to nothing." in ended.out
    assert "gone " in ended.out.partition("Others:")[2]


def test_each_command_stands_in_the_help_with_a_summary_that_fits_a_line(call: Call) -> None:
    lines = call("--help").out.splitlines()
    for name in registry.available("cellwatt.commands"):
        [line] = [line for line in lines if line.startswith(f"  {name} ")]
        assert line.endswith(".") and not line.endswith("...") and len(line) <= 80, line
    assert "Others:" not in lines


def test_a_full_disk(call: Call, place: Path, tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        ended = call("plot", place / "recordings", "--out", tmp_path / "a.html")
        exported = call("export", place / "recordings", "--out", tmp_path / "tables")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert (ended.code, ended.err.count("\n")) == (ERROR, 1)
    assert "a.html cannot be written: File too large" in ended.err
    assert (exported.code, exported.err.count("\n")) == (ERROR, 1)
    assert "File too large" in exported.err


def broken(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    monkeypatch.setattr("cellwatt.commands.check.load", Mock(side_effect=error))


def test_a_mistake_of_ours_is_one_line_that_says_where_its_traceback_is_or_on_request_the_traceback(
    call: Call, cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CELLWATT_TRACEBACK")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    broken(monkeypatch, ZeroDivisionError("division by zero"))
    ended = call("check", cell)
    told, _, file = ended.err.partition(" (the traceback is in ")
    assert ended.code == BUG
    assert told == "cellwatt: this is a bug in cellwatt, please report it: ZeroDivisionError: division by zero"
    assert "Traceback (most recent call last)" in Path(file.strip().removesuffix(")")).read_text()
    monkeypatch.setenv("CELLWATT_TRACEBACK", "1")
    assert call("check", cell).err.startswith("Traceback (most recent call last)")


def test_a_package_that_a_command_misses_while_it_runs_is_named(
    call: Call, cell: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken(monkeypatch, ModuleNotFoundError("No module named 'scipy.special'", name="scipy.special"))
    ended = call("check", cell)
    assert ended.code == USAGE
    assert ended.err == "cellwatt: this needs the package scipy.special: pip install 'cellwatt[all]'\n"


def test_sources_that_change_within_a_session(call: Call, tmp_path: Path) -> None:
    board = Stream("power", (Channel("bus.power", "W"),), 50.0, "host")
    making.write_chunks(tmp_path, [[making.batch_of(0, 15)]], header=making.weld(""))
    both = [making.batch_of(15, 15), making.batch_of(0, 15, stream=board, source="board", device=False)]
    making.write_chunks(tmp_path, [both], number=2, header=making.weld("", board=(board,)))
    ended = call("replay", tmp_path)
    assert ended.code == ERROR
    assert "the sources change within these recordings (board.power): replay them one by one" in ended.err
    assert call("replay", sorted(tmp_path.glob("*.mcap"))[1]).code == 0


def test_channels_that_change_within_recordings(call: Call, tmp_path: Path) -> None:
    torque = replace(making.ARM, channels=(*making.ARM.channels[:5], Channel("joint_6.torque", "Nm")))
    for number, stream in ((1, making.ARM), (2, torque)):
        batch = making.batch_of(15 * number, 15, stream=stream)
        making.write_chunks(tmp_path, [[batch]], number=number, header=making.weld("", arm=(stream,)))
    changed = "the channels of arm/rtde change within these recordings: {} them one by one"
    for name, more in (("export", ("--out", tmp_path / "out")), ("replay", ())):
        ended = call(name, tmp_path, *more)
        assert ended.code == ERROR and changed.format(name) in ended.err
    with pytest.raises(RecordingError, match=changed.format("read")):
        Recording.open(tmp_path).raw("arm/rtde")
    assert len(Recording.open(sorted(tmp_path.glob("*.mcap"))[1]).raw("arm/rtde")) == 15


def test_frames_that_came_from_the_environment(call: Call, tmp_path: Path) -> None:
    making.write_chunks(tmp_path, [[making.batch_of(0, 15)]], header=making.weld("frames: {rate: '${RATE}'}\n"))
    ended = call("replay", tmp_path)
    assert ended.code == ERROR
    assert "are wrong, or came from the environment: give them with --settings" in ended.err


def test_a_terminal_without_the_characters_of_a_table(call: Call, cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cell.write_text(f"{CELL}record: {{folder: Aufträge…}}\n")
    terminal = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(terminal, "latin-1", write_through=True))
    assert call("check", cell).code == 0
    assert "/Aufträge?; outlets: zenoh" in terminal.getvalue().decode("latin-1")
