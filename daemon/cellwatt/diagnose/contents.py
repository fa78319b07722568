"""Gathers the parts of a bundle; each part that cannot be had is told and the rest goes on."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, Final

from cellwatt.config import CellConfig, load, public_config
from cellwatt.config.document import read
from cellwatt.diagnose import pc
from cellwatt.diagnose.bundle import Bundle
from cellwatt.errors import CellwattError, ConfigError, RecordingError
from cellwatt.files import read_bytes
from cellwatt.host import HIDDEN
from cellwatt.outlets.zenoh.reach import ask_cell
from cellwatt.record.cut import cut
from cellwatt.record.folder import Obstacles, RecordFile, listing, obstacles
from cellwatt.record.header import DAMAGED
from cellwatt.record.survey import survey
from cellwatt.runtime.assemble import prepare
from cellwatt.version import __version__

_SUSPECT: Final = ("pass", "pw", "secret", "token", "key", "credential")
"""Parts of keys below which a wrong file may hold secrets that no settings class has declared."""


@dataclass(slots=True)
class Findings:
    """A settings file examined: ``config`` if it is right, ``secrets`` with what to show for each."""

    config: CellConfig | None
    shown: dict[str, Any]
    check: list[str]
    secrets: dict[str, str] = field(default_factory=dict)


def examine(file: Path) -> Findings:
    """Read and check a settings file, right or wrong."""
    try:
        config = load(file)
    except ConfigError as error:
        return _wrong(file, [str(problem) for problem in error.problems])
    disk = obstacles(config.record) if config.record is not None else Obstacles()
    warnings = [*config.warnings, *disk.warnings]
    told = [*_unprepared(config), *([disk.refusal] if disk.refusal else []), *(f"warning: {text}" for text in warnings)]
    return Findings(config, public_config(config), told, dict(config.secrets))


def _unprepared(config: CellConfig) -> list[str]:
    try:
        prepare(config)
    except ConfigError as error:
        return [str(problem) for problem in error.problems]
    return [f"{config.path}: configuration is valid"]


def _wrong(file: Path, problems: list[str]) -> Findings:
    try:
        document = read(file, os.environ)
    except ConfigError:
        return Findings(None, {}, problems)
    secrets = dict(document.secrets)
    for path, place in document.places.items():
        if place.written and any(word in str(key).lower() for key in path for word in _SUSPECT):
            secrets[place.written] = HIDDEN
    return Findings(None, {}, problems, secrets)


LINES: Final = 2000
"""Last lines of the log."""
PATIENCE: Final = 10.0
"""s for an answer of the running daemon."""
_MOST_LOG: Final = 100_000_000
_EXAMINED: Final = 100
"""Recordings, the newest ones, that are opened for a verdict."""


def bundle_of(file: Path | None, log: Path | None, record: float, folder: Path) -> Bundle:
    """Gather the bundle for a settings file, or for the PC alone.

    ``log`` replaces the journal. The last ``record`` s of the record are cut into ``folder``; 0 leaves them out.
    """
    bundle = Bundle()
    bundle.add("versions.json", "versions of cellwatt, Python, its packages and the system", _versions)
    config = None
    if file is not None:
        found = examine(file)
        config, bundle.secrets = found.config, found.secrets
        bundle.add("check.txt", "what cellwatt check says", lambda: "\n".join(found.check))
        bundle.add("settings.json", "the settings without secrets", lambda: found.shown or _wrong_file())
    disk = config.record.folder if config is not None and config.record is not None else None
    bundle.add("pc.json", "cores, clocks, memory, limits and disk of this PC", lambda: pc.facts(disk))
    if log is not None or file is not None:
        bundle.add("log.txt", f"the last {LINES} lines of the log", lambda: _log(file, log))
    if config is not None:
        _cell(bundle, config, record, folder)
    return bundle


def _cell(bundle: Bundle, config: CellConfig, record: float, folder: Path) -> None:
    bundle.add("status.json", "health and counts of the running daemon", lambda: ask_cell(config, "status"), PATIENCE)
    if "status.json" in bundle.texts:
        bundle.add("schema.json", "its channels", lambda: ask_cell(config, "schema"), PATIENCE)
    if config.record is None:
        return
    kept = listing(config.record.folder, config.cell)
    bundle.add("recordings.json", "recordings with sizes and verdicts", lambda: _recordings(kept))
    if record:
        try:
            made = _last(config, kept, record, folder / "record.mcap")
        except (CellwattError, OSError) as error:
            bundle.missing["record.mcap"] = f"the last {record:g} s of the record: {error}"
        else:
            bundle.files["record.mcap"] = f"the last {record:g} s of the record", made


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


def _wrong_file() -> str:
    raise CellwattError("the file is wrong, and may hold secrets anywhere: see check.txt")


def _log(file: Path | None, log: Path | None) -> str:
    if log is not None:
        return "\n".join(read_bytes(log, _MOST_LOG).decode("utf-8", "replace").splitlines()[-LINES:])
    assert file is not None
    unit = f"cellwatt@{file.stem}"
    command = ["journalctl", "-u", unit, "-n", str(LINES), "--no-pager", "-o", "short-iso-precise", "-q"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=30, check=False)
    except (FileNotFoundError, subprocess.TimeoutExpired):
        raise CellwattError("there is no journal to ask; give the log with --log FILE") from None
    if not done.stdout.strip():
        reason = done.stderr.strip() or "it has no lines that this user may read"
        raise CellwattError(f"journal of {unit}: {reason}; run as root, or give the log with --log FILE")
    return done.stdout


def _recordings(kept: list[RecordFile]) -> list[dict[str, Any]]:
    newest = kept[-_EXAMINED:]
    return [
        {
            "file": k.path.name,
            "size, B": k.size,
            "written": datetime.fromtimestamp(k.modified, UTC).isoformat(timespec="seconds"),
            "verdict": _verdict(k) if k in newest else "not examined",
        }
        for k in kept
    ]


def _verdict(kept: RecordFile) -> str:
    if kept.path.name.endswith(DAMAGED):
        return "damaged, set aside"
    try:
        found = survey(kept.path, chunks=False)
    except RecordingError as error:
        return str(error)
    damage = "; ".join(map(str, found.damage))
    return damage or ("whole" if found.closed else "open")


def _last(config: CellConfig, kept: list[RecordFile], seconds: float, to: Path) -> Path:
    """The end of the record; of a cell that stopped, what it recorded last."""
    ends = [end for k in kept[-3:] if (end := _end(k))]
    if config.record is None or not ends:
        raise RecordingError("nothing was recorded that can be read")
    return cut(config.record.folder, config.cell, max(ends) - round(seconds * 1e9), max(ends), to).path


def _end(kept: RecordFile) -> int:
    try:
        return survey(kept.path).contents.end
    except RecordingError:
        return 0
