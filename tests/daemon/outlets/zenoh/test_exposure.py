"""Who may come in by a cell's settings, and that strangers may only on purpose."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner
from pydantic import ValidationError

from cellwatt import ConfigError
from cellwatt.commands import check, doctor
from cellwatt.config import load
from cellwatt.outlets.zenoh import ZenohSettings
from tests.daemon.outlets.zenoh.processes import ROOT, free_port
from tests.daemon.outlets.zenoh.test_link import CELL, written

TLS = {"root_ca": "ca.pem", "certificate": "cell.pem", "key": "cell.key"}
RULES = {"enabled": True, "default_permission": "deny", "rules": [], "subjects": [], "policies": []}
SECURED: dict[str, Any] = {"tls": TLS, "options": {"access_control": RULES}}


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/127.0.0.1:7447", "tcp/127.1.2.3:7447", "tcp/[::1]:7447", "tcp/localhost:7447", "unixsock-stream//run/cell"],
)
def test_this_pc_alone_needs_nothing(endpoint: str) -> None:
    assert ZenohSettings(listen=(endpoint,)).warnings() == ()


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        ({"listen": ["tcp/0.0.0.0:7447"]}, "without TLS and access rules"),
        ({"listen": ["tcp/192.0.2.1:7447#iface=lo"]}, "without TLS and access rules"),
        ({**SECURED, "listen": ["tcp/192.0.2.1:7447"]}, "without TLS"),
        (
            {"listen": ["tls/0.0.0.0:1"], "tls": TLS, "options": {"access_control": RULES | {"enabled": False}}},
            "without access rules",
        ),
        (
            {**SECURED, "listen": ["tls/0.0.0.0:1"], "options": {"access_control/default_permission": "allow"}},
            "without access rules",
        ),
        ({"options": {"listen/endpoints": ["tcp/192.0.2.1:7447"]}}, "without TLS and access rules"),
        ({"options": {"listen": {"endpoints": {"peer": ["tcp/192.0.2.1:1"]}}}}, "without TLS and access rules"),
        ({"options": {"scouting/multicast": {"enabled": True}}}, "any session on the local network"),
    ],
)  # fmt: skip
def test_the_network_is_let_in_only_on_purpose(settings: dict[str, Any], what: str) -> None:
    with pytest.raises(ValidationError, match=f"{what}: anyone .* or set open: true"):
        ZenohSettings(**settings)
    (warning,) = [w for w in ZenohSettings(open=True, **settings).warnings() if "cannot be read" not in w]
    assert what in warning


@pytest.mark.parametrize("listen", ["tls/0.0.0.0:7447", "quic/192.0.2.1:7447"])
def test_tls_with_rules_needs_no_word(listen: str, tmp_path: Path) -> None:
    settings = ZenohSettings(listen=(listen,), **SECURED)
    assert not any("open" in warning for warning in settings.warnings())
    one_by_one = {"access_control/enabled": True, "access_control/default_permission": "deny"}
    ZenohSettings(listen=(listen,), tls=TLS, options=one_by_one)


def test_the_place_is_told_by_line_and_column(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        "zenoh:\n  listen: [tcp/127.0.0.1:1, tcp/192.0.2.1:1]\n  options: {scouting/multicast/enabled: true}\n",
    )
    with pytest.raises(ConfigError) as caught:
        load(file)
    first, second = map(str, caught.value.problems)
    assert first.startswith(f"{file}:6:29: zenoh.listen[1]: found 'tcp/192.0.2.1:1': open to the network without")
    assert second.startswith(f"{file}:7:3: zenoh.options: finds, and links with,")
    file = written(tmp_path, "zenoh: {listen: [tls/127.0.0.1:1], tls: {root_ca: ca.pem}}\n")
    with pytest.raises(
        ConfigError, match=r"cell.yaml:5:1: zenoh: to listen, tls/127.0.0.1:1 needs .*certificate: FILE"
    ):
        load(file)


def test_check_and_doctor_warn_and_go_on(tmp_path: Path) -> None:
    nobody = CELL.replace("192.0.2.10", f"127.0.0.1, port: {free_port()}")
    file = tmp_path / "cell.yaml"
    file.write_text(nobody + "zenoh: {open: true, listen: [tcp/192.0.2.1:7447]}\n")
    expected = f"{file}: warning: zenoh: tcp/192.0.2.1:7447: open to the network without TLS and access rules"
    checked = CliRunner().invoke(check.command, [str(file)], catch_exceptions=False)
    assert checked.exit_code == 0
    assert checked.stderr.startswith(expected)
    looked = CliRunner().invoke(doctor.command, [str(file), "--seconds", "0.1", "--patience", "0.5", "--json"])
    assert looked.stderr.startswith(expected)
    assert looked.stdout.startswith(("[", "{"))


PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md")), *sorted(ROOT.glob("examples/**/*.yaml"))]
LISTENING = re.compile(r"listen\w*:\s*\[([^]]*)]")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_example_of_ours_lets_strangers_in(page: Path) -> None:
    text = re.sub(r"\$\{\w+:-([^}]*)}", r"\1", page.read_text())  # the default of a variable
    for endpoints in LISTENING.findall(text):
        ZenohSettings(listen=tuple(yaml.safe_load(f"[{endpoints}]")), tls=TLS if "tls/" in endpoints else None)


def test_a_key_to_sign_with_that_is_missing_is_told_by_check(tmp_path: Path) -> None:
    cell = written(tmp_path, "record: {folder: rec}\nzenoh: {sign: sign.key}\n")
    told = CliRunner().invoke(check.command, [str(cell)])
    assert told.exit_code == 0
    assert f"warning: zenoh: sign: {tmp_path / 'sign.key'} cannot be read" in told.output
