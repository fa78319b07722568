"""Collects the files of a bundle; a file that cannot be collected is listed with the reason."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import threading
from concurrent.futures import Future
from datetime import UTC, datetime
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, Final

from cellwatt.child import MODULE
from cellwatt.config import CellConfig, load, public_config
from cellwatt.config.document import read
from cellwatt.diagnose import pc
from cellwatt.diagnose.bundle import Bundle
from cellwatt.errors import CellwattError, ConfigError, RecordingError
from cellwatt.files import read_bytes
from cellwatt.host import HIDDEN
from cellwatt.outlets.zenoh.reach import ask_cell
from cellwatt.record.folder import RecordFile, listing
from cellwatt.record.header import DAMAGED
from cellwatt.record.survey import survey
from cellwatt.version import __version__

_SUSPECT: Final = ("pass", "pw", "secret", "token", "key", "credential")
"""Words in keys below which an invalid file may contain secrets that no settings class declares."""
LINES: Final = 2000
"""Number of lines taken from the end of the log."""
PATIENCE: Final = 10.0
"""s for an answer of the running daemon."""
_MOST_LOG: Final = 100_000_000
_EXAMINED: Final = 100
"""Number of newest recordings that are opened for a verdict."""


def bundle_of(file: Path | None, log: Path | None) -> Bundle:
    """Collect the bundle for a settings file, or for the PC alone; ``log`` replaces the journal."""
    bundle = Bundle()
    bundle.add("versions.json", "versions of cellwatt, Python, its packages and the system", _versions)
    config = None if file is None else _settings(bundle, file)
    disk = config.record.folder if config is not None and config.record is not None else None
    bundle.add("pc.json", "cores, clocks, memory, limits and disk of this PC", lambda: pc.facts(disk))
    if log is not None or file is not None:
        bundle.add("log.txt", f"the last {LINES} lines of the log", lambda: _log(file, log))
    if config is not None:
        _cell(bundle, config)
    return bundle


def _settings(bundle: Bundle, file: Path) -> CellConfig | None:
    """Add the settings; of an invalid file, which may contain secrets anywhere, only the problems."""
    bundle.add("check.txt", "output of cellwatt check", lambda: _checked(file))
    try:
        config = load(file)
    except ConfigError:
        bundle.secrets = _suspected(file)
        bundle.missing["settings.json"] = "the settings: the file is invalid and may contain secrets: see check.txt"
        return None
    bundle.secrets = dict(config.secrets)
    bundle.add("settings.json", "the settings without secrets", lambda: public_config(config))
    return config


def _checked(file: Path) -> str:
    command = [*MODULE, "cellwatt.commands", "check", "--", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=60, check=False)
    return done.stdout + done.stderr


def _suspected(file: Path) -> dict[str, str]:
    """Values that may be secrets in an invalid file."""
    try:
        document = read(file, os.environ)
    except ConfigError:
        return {}
    suspect = {
        place.written: HIDDEN
        for path, place in document.places.items()
        if place.written and any(word in str(key).lower() for key in path for word in _SUSPECT)
    }
    return document.secrets | suspect


def _cell(bundle: Bundle, config: CellConfig) -> None:
    bundle.add("status.json", "health and counts of the running daemon", lambda: _asked(config, "status"))
    if "status.json" in bundle.texts:
        bundle.add("schema.json", "its channels", lambda: _asked(config, "schema"))
    if (record := config.record) is not None:
        about = "list of recordings with sizes and verdicts"
        bundle.add("recordings.json", about, lambda: _recordings(listing(record.folder, config.cell)))


def _asked(config: CellConfig, question: str) -> dict[str, Any]:
    """The answer of the running daemon, in ``PATIENCE``; a thread that takes longer ends with the command."""
    done: Future[dict[str, Any]] = Future()

    def work() -> None:
        try:
            done.set_result(ask_cell(config, question))
        except BaseException as error:  # raised where it is waited for
            done.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        return done.result(PATIENCE)
    except TimeoutError:
        raise CellwattError(f"there was no answer within {PATIENCE:.0f} s") from None


def _versions() -> dict[str, Any]:
    return {
        "cellwatt": __version__,
        "python": sys.version,
        "implementation": platform.python_implementation(),
        "executable": sys.executable,
        "system": platform.platform(),
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "packages": dict(sorted((d.name, d.version) for d in distributions())),
    }


def _log(file: Path | None, log: Path | None) -> str:
    if log is not None:
        return "\n".join(read_bytes(log, _MOST_LOG).decode("utf-8", "replace").splitlines()[-LINES:])
    assert file is not None
    unit = f"cellwatt@{file.stem}"
    command = ["journalctl", "-u", unit, "-n", str(LINES), "--no-pager", "-o", "short-iso-precise", "-q"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=30, check=False)
    except (FileNotFoundError, subprocess.TimeoutExpired):
        raise CellwattError("the journal cannot be read; give the log with --log FILE") from None
    if not done.stdout.strip():
        reason = done.stderr.strip() or "no lines that this user may read"
        raise CellwattError(f"journal of {unit}: {reason}; run as root, or give the log with --log FILE")
    return done.stdout


def _recordings(recordings: list[RecordFile]) -> list[dict[str, Any]]:
    newest = recordings[-_EXAMINED:]
    return [
        {
            "file": k.path.name,
            "size, B": k.size,
            "written": datetime.fromtimestamp(k.modified, UTC).isoformat(timespec="seconds"),
            "verdict": _verdict(k) if k in newest else "not examined",
        }
        for k in recordings
    ]


def _verdict(recording: RecordFile) -> str:
    if recording.path.name.endswith(DAMAGED):
        return "damaged, set aside"
    try:
        found = survey(recording.path, chunks=False)
    except RecordingError as error:
        return str(error)
    damage = "; ".join(map(str, found.damage))
    return damage or ("whole" if found.closed else "open")
