"""How a program beside the daemon reaches a cell."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellwatt.config import load
from cellwatt.errors import ConfigError
from cellwatt.outlets.zenoh.reach import link_to

CELL = "site: plant\ncell: weld\nsources:\n  arm: {driver: ur, host: 192.0.2.10}\n"


def written(folder: Path, zenoh: str = "") -> Path:
    file = folder / "cell.yaml"
    file.write_text(CELL + zenoh)
    return file


def test_a_cell_that_listens_everywhere_is_reached_on_this_pc(tmp_path: Path) -> None:
    config = load(
        written(
            tmp_path, "zenoh: {open: true, listen: [tcp/0.0.0.0:7447], connect: [tcp/router:7447], namespace: eu}\n"
        )
    )
    link = link_to(config)
    assert (link.mode, link.connect, link.listen, link.namespace) == ("client", ("tcp/127.0.0.1:7447",), (), "eu")
    assert link_to(config, "tcp/other:1").connect == ("tcp/other:1",)
    assert link_to(config, "tcp/other:1").namespace == "eu"


def test_a_cell_behind_a_router_is_reached_there(tmp_path: Path) -> None:
    assert link_to(load(written(tmp_path, "zenoh: {connect: [tcp/router:7447]}\n"))).connect == ("tcp/router:7447",)


def test_a_cell_that_is_not_on_the_bus_is_told_with_its_file(tmp_path: Path) -> None:
    file = written(tmp_path)
    with pytest.raises(ConfigError, match=r"cell\.yaml: the cell is not on the bus: .* nor connect; or so"):
        link_to(load(file), hint="; or so")
    assert link_to(load(file), "tcp/other:1").connect == ("tcp/other:1",)


def test_the_cells_own_file_carries_its_certificates(tmp_path: Path) -> None:
    rules = "access_control: {enabled: true, default_permission: deny, rules: [], subjects: [], policies: []}"
    file = tmp_path / "cell.yaml"
    file.write_text(
        f"{CELL}zenoh:\n  listen: [tls/0.0.0.0:7447]\n  options: {{{rules}}}\n"
        "  tls: {root_ca: ca, certificate: cell, key: cell.key}\n"
    )
    link = link_to(load(file))
    assert link.tls is not None
    assert (link.connect, link.tls.certificate) == (("tls/127.0.0.1:7447",), tmp_path / "cell")
    assert not link.tls.verify_name, "the certificate names the PC, not its loopback address"
    other = link_to(load(file), "tls/weld-3:7447").tls
    assert other is not None
    assert other.verify_name
