from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from cellwatt import OutletError
from cellwatt.config import load
from cellwatt.errors import ConfigError
from cellwatt.outlets.zenoh.link import LinkSettings, TlsSettings, open_session, session_config
from cellwatt.outlets.zenoh.reach import link_to
from tests.daemon.conftest import certificates
from tests.daemon.outlets.zenoh.processes import free_port

__all__ = ["certificates"]

HOST = "127.0.0.1"


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"mode": "bus"}, "'peer', 'client' or 'router'"),
        ({"mode": "client"}, "mode client needs an endpoint in connect, like tcp/plant-router:7447"),
        ({"listen": ["tcp/192.0.2.1"]}, "is not an endpoint"),
        ({"connect": ["tls/router:7447"]}, r"tls/router:7447 needs tls: \{root_ca: FILE"),
        ({"user": "edge"}, "user and password are needed together"),
        ({"tls": {"root_ca": "a", "key": "b"}}, "certificate and key are needed together"),
        ({"options": {"no/such": 1}}, r"Zenoh refuses options: no/such = 1: unknown key"),
        ({"options": {"access_control": {"enabled": True, "rule": []}}}, "unknown field `rule`, expected one of"),
        ({"options": {"transport/auth/usrpwd/password": 5}}, r"usrpwd/password = …"),
    ],
)
def test_settings_mistakes_are_named(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(ValidationError, match=text) as caught:
        LinkSettings(**settings)
    assert ".cargo" not in str(caught.value)


def test_nothing_is_exposed_or_looked_for_by_default() -> None:
    config = session_config(LinkSettings())
    assert config.get_json("mode") == '"peer"'
    assert config.get_json("listen/endpoints") == "[]"
    assert config.get_json("connect/endpoints") == "[]"
    assert config.get_json("scouting/multicast/enabled") == "false"
    assert config.get_json("scouting/gossip/enabled") == "false"


def test_an_address_that_is_taken_is_named() -> None:
    endpoint = f"tcp/{HOST}:{free_port()}"
    with open_session(LinkSettings(listen=(endpoint,))), pytest.raises(OutletError, match="Address already in use"):
        open_session(LinkSettings(listen=(endpoint,)))


@pytest.mark.parametrize("first", ["dead", "unknown", "both"])
def test_a_router_further_down_the_list_is_found(first: str) -> None:
    live = f"tcp/{HOST}:{free_port()}"
    with socket.create_server((HOST, 0)) as silent, open_session(LinkSettings(mode="router", listen=(live,))) as router:
        away = {
            "dead": [f"tcp/{HOST}:{free_port()}"],
            "unknown": ["tcp/no-such-host.invalid:7447"],
            "silent": [f"tcp/{HOST}:{silent.getsockname()[1]}"],
        }
        endpoints = away[first] if first != "both" else away["dead"] + away["silent"]
        client = LinkSettings(mode="client", connect=(*endpoints, live))
        with open_session(client, patience=0) as session:
            assert [str(zid) for zid in session.info.routers_zid()] == [str(router.zid())]


def test_each_endpoint_is_told_with_its_own_reason() -> None:
    dead = f"tcp/{HOST}:{free_port()}"
    with socket.create_server((HOST, 0)) as server:
        silent = f"tcp/{HOST}:{server.getsockname()[1]}"
        with pytest.raises(OutletError) as told:
            open_session(LinkSettings(mode="client", connect=(dead, silent)), patience=0)
    one, other = str(told.value).split("; ")
    assert one.startswith(f"{dead}: no answer")
    assert other.startswith(f"{silent}: the port answers but refuses")


def test_opening_can_be_stopped() -> None:
    endpoint = f"tcp/{HOST}:{free_port()}"
    with pytest.raises(OutletError, match="no answer"):
        open_session(LinkSettings(mode="client", connect=(endpoint,)), lambda: True, patience=3600)


@pytest.mark.parametrize(
    ("user", "password", "accepted"),
    [("edge", "correct", True), ("edge", "wrong", False), ("other", "correct", False), (None, None, False)],
)
def test_user_and_password(tmp_path: Path, user: str | None, password: str | None, accepted: bool) -> None:
    users = tmp_path / "users"
    users.write_text("edge:correct\n")
    accepted_users = {"transport/auth/usrpwd/dictionary_file": str(users)}
    endpoint = f"tcp/{HOST}:{free_port()}"
    client = LinkSettings(mode="client", connect=(endpoint,), user=user, password=password)
    with open_session(LinkSettings(mode="router", listen=(endpoint,), options=accepted_users)):
        if accepted:
            open_session(client).close()
            return
        with pytest.raises(OutletError, match="refuses the session: check user and password"):
            open_session(client, patience=0.5)


GONE = "missing.pem"


@pytest.mark.parametrize(("option", "file"), [("root_ca", GONE), ("certificate", GONE), ("key", GONE), ("key", "ca")])
def test_a_file_that_is_missing_or_holds_no_key_is_named(certificates: Path, option: str, file: str) -> None:
    files = {"root_ca": "ca", "certificate": "cell", "key": "cell.key"} | {option: file}
    settings = TlsSettings(**{name: certificates / file for name, file in files.items()})
    missing = rf"^tls\.{option}: .*missing\.pem cannot be read: No such file"
    with pytest.raises(OutletError, match=missing if file == GONE else "private key"):
        open_session(LinkSettings(listen=(f"tls/localhost:{free_port()}",), tls=settings))


# How a program beside the daemon reaches a cell ---


CELL = "site: plant\ncell: weld\nsources:\n  arm: {driver: ur, host: 192.0.2.10}\n"


def written(folder: Path, zenoh: str = "") -> Path:
    file = folder / "cell.yaml"
    file.write_text(CELL + zenoh)
    return file


def test_a_cell_that_listens_everywhere_is_reached_on_this_pc(tmp_path: Path) -> None:
    listening = "open: true, listen: [tcp/0.0.0.0:7447], connect: [tcp/router:7447]"
    config = load(written(tmp_path, f"zenoh: {{{listening}}}\n"))
    link = link_to(config)
    assert (link.mode, link.connect, link.listen) == ("client", ("tcp/127.0.0.1:7447",), ())
    assert link_to(config, "tcp/other:1").connect == ("tcp/other:1",)
    routers = written(tmp_path, "zenoh: {mode: client, connect: [tcp/one:7447, tcp/two:7447]}\n")
    assert link_to(load(routers)).connect == ("tcp/one:7447", "tcp/two:7447"), "as the daemon: whichever is up"


def test_a_cell_that_is_not_on_the_bus_is_told_with_its_file(tmp_path: Path) -> None:
    file = written(tmp_path)
    with pytest.raises(ConfigError, match=r"cell\.yaml: the cell is not on the bus: .* nor connect; or so"):
        link_to(load(file), hint="; or so")
    assert link_to(load(file), "tcp/other:1").connect == ("tcp/other:1",)


def test_the_cells_own_file_carries_its_certificates(tmp_path: Path) -> None:
    rules = "access_control: {enabled: true, default_permission: deny, rules: [], subjects: [], policies: []}"
    tls = "tls: {root_ca: ca, certificate: cell, key: cell.key}"
    file = written(tmp_path, f"zenoh:\n  listen: [tls/0.0.0.0:7447]\n  options: {{{rules}}}\n  {tls}\n")
    link = link_to(load(file))
    assert link.tls is not None
    assert (link.connect, link.tls.certificate) == (("tls/127.0.0.1:7447",), tmp_path / "cell")
    assert not link.tls.verify_name, "the certificate names the PC, not its loopback address"
    other = link_to(load(file), "tls/weld-3:7447").tls
    assert other is not None
    assert other.verify_name
