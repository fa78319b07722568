"""``cellwatt notify --test`` as a process, with real servers."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from cellwatt.commands.notify import command
from cellwatt.errors import ConfigError
from tests.daemon.outlets.notify.servers import mail_server, web_server

CELL = {"site": "plant-1", "cell": "weld-3", "sources": {"arm": {"driver": "ur", "host": "192.0.2.10"}}}


def written(folder: Path, to: dict[str, Any] | None) -> Path:
    file = folder / "cell.yaml"
    file.write_text(yaml.safe_dump(CELL if to is None else {**CELL, "notify": {"to": to, "timeout": "5 s"}}))
    return file


async def call(folder: Path, to: dict[str, Any], *arguments: str) -> tuple[int, str, str]:
    words = [sys.executable, "-m", "cellwatt.commands", "notify", "--test", str(written(folder, to)), *arguments]
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*words, stdout=pipe, stderr=pipe)
    out, err = await process.communicate()
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


async def test_each_recipient_is_tried(tmp_path: Path) -> None:
    async with web_server() as server, mail_server() as box:
        server.answers = [404]
        mail = {"host": "localhost", "port": box.port, "tls": "none", "from": "a@b.example", "to": ["c@d.example"]}
        to = {"desk": {"webhook": {"url": f"{server.url}/geheim"}}, "shift": {"mail": mail}}
        code, out, err = await call(tmp_path, to)
        assert (code, err) == (3, "")
        assert sorted(out.splitlines()) == [
            f"desk (webhook by {server.url}): 404 Not Found: are token and address right?",
            f"shift c@d.example (mail by localhost:{box.port}): ok",
        ]
        assert [mail["Subject"] for _, mail in box.mails] == ["[plant-1/weld-3] test: cellwatt reaches you"]
        code, out, _ = await call(tmp_path, to, "desk", "--json")
        assert (code, json.loads(out)) == (0, {"desk": None})
        assert server.calls[-1].json["alarms"] == []
        assert len(box.mails) == 1


def test_mistakes_of_the_user(tmp_path: Path) -> None:
    arguments = ["--test", str(written(tmp_path, None))]
    with pytest.raises(ConfigError, match="no notify section: name the recipients"):
        command.main(arguments, standalone_mode=False)
    written(tmp_path, {"desk": {"webhook": {"url": "http://127.0.0.1:1/"}}})
    with pytest.raises(ConfigError, match=r"no recipient 'dsek' \(known: desk\)"):
        command.main([*arguments, "dsek"], standalone_mode=False)
    with pytest.raises(click.MissingParameter, match="test"):
        command.main([arguments[1]], standalone_mode=False)
