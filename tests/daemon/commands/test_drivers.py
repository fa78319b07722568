from __future__ import annotations

import json

from click.testing import CliRunner

from cellwatt.commands.drivers import command


def run(*arguments):
    return CliRunner().invoke(command, arguments, catch_exceptions=False)


def test_list():
    result = run()
    assert result.exit_code == 0
    rows = [line.split(maxsplit=2) for line in result.output.splitlines()]
    assert [row[:2] for row in rows] == [
        ["kind", "name"],
        ["driver", "absent"],
        ["driver", "arm"],
        ["driver", "broken"],
        ["driver", "meter"],
        ["stage", "cut"],
        ["stage", "net"],
        ["stage", "watch"],
        ["outlet", "log"],
        ["outlet", "zenoh"],
    ]
    assert "cannot be loaded: driver 'absent'" in rows[1][2]
    assert rows[2][2].endswith("Arm of the tests")


def test_list_as_json():
    loads = {part["name"]: part["loads"] for part in json.loads(run("--json").stdout)}
    assert loads["arm"] and not loads["absent"]


def test_installed_parts_name_their_package(real_parts):
    from importlib.metadata import version

    ours = [p for p in json.loads(run("--json").stdout) if p["package"] == "cellwatt"]
    assert {p["version"] for p in ours} == {version("cellwatt")}
    assert {"ur", "yaskawa", "power_board", "scpi_analyzer"} <= {p["name"] for p in ours if p["kind"] == "driver"}


def test_page_of_a_driver():
    result = run("arm")
    assert result.exit_code == 0
    text = result.output
    assert "An arm on the network." in text
    rows = {line.split()[0]: line for line in text.splitlines() if line}
    assert "(required)" in rows["host"]
    assert "quantity, like 500 Hz" in rows["rate"]
    assert "Samples a second." in rows["rate"]
    assert "May send to the device:\n  - a greeting" in text
    assert rows["state"].split() == ["state", "500", "Hz", "supply.power", "W", "continuous", "average"]


def test_page_of_a_stage_names_what_it_needs():
    text = run("watch").output
    assert "Needs stages of the kind: cut" in text
    assert "10 %" in text


def test_page_as_json():
    (page,) = json.loads(run("arm", "--json").stdout)
    assert page["writes"] == ["a greeting"]
    host = next(f for f in page["settings"] if f["key"] == "host")
    assert host["required"] is True
    assert host["description"].startswith("Address of the controller")


def test_unknown_name():
    result = run("amr")
    assert result.exit_code == 2
    assert "no driver, stage or outlet named 'amr'; did you mean 'arm'?" in result.output


def test_part_that_does_not_load():
    result = run("absent")
    assert result.exit_code == 2
    assert "no_such_package_anywhere" in result.output
