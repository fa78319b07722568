"""A log that neither floods nor tells secrets."""

from __future__ import annotations

import errno
import io
import logging
from collections.abc import Iterator

import pytest

from cellwatt.progress import log_lines
from cellwatt.progress.log_lines import MOST, LogLines


@pytest.fixture
def written() -> Iterator[tuple[logging.Logger, io.StringIO]]:
    handler, log = LogLines(), logging.Logger("cellwatt.test", logging.INFO)
    handler.setStream(io.StringIO())
    log.addHandler(handler)
    yield log, handler.stream


def test_a_flood_is_a_few_lines_and_a_count(written: tuple[logging.Logger, io.StringIO], monkeypatch) -> None:
    log, stream = written
    for n in range(1000):
        log.warning("connection %d refused", n)
        log.info("something else")
    lines = stream.getvalue().splitlines()
    assert sum("refused" in line for line in lines) == MOST
    assert sum("are left out for a minute" in line for line in lines) == 2
    monkeypatch.setattr(log_lines, "SPAN", 0.0)
    log.warning("connection %d refused", 1000)
    assert stream.getvalue().splitlines()[-2:] == [
        f"WARNING cellwatt.test: {1000 - MOST} more lines like the next were left out",
        "WARNING cellwatt.test: connection 1000 refused",
    ]


def test_a_full_disk_behind_stderr_does_not_end_who_logs(written, monkeypatch: pytest.MonkeyPatch) -> None:
    log, stream = written
    monkeypatch.setattr(logging, "raiseExceptions", False)
    monkeypatch.setattr(stream, "write", lambda _: (_ for _ in ()).throw(OSError(errno.ENOSPC, "full")))
    for _ in range(MOST + 1):
        log.warning("again")


def test_a_traceback_is_told_once(written: tuple[logging.Logger, io.StringIO]) -> None:
    log, stream = written
    for _ in range(3):
        try:
            raise ValueError("broken")
        except ValueError:
            log.exception("a request cannot be answered")
    text = stream.getvalue()
    assert (text.count("cannot be answered"), text.count("Traceback")) == (3, 1)


def test_no_secret_of_an_address_is_logged(written: tuple[logging.Logger, io.StringIO]) -> None:
    log, stream = written
    log.warning("%s cannot be reached", "mqtt://u:hunter2@plant")
    assert stream.getvalue() == "WARNING cellwatt.test: mqtt://***@plant cannot be reached\n"
