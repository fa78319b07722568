"""The outlets of the demo: their settings, what is left out, the table, the summary, and extras that are missing."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from cellwatt.config import load
from cellwatt.demo import cells
from cellwatt.demo.outlets import programs
from cellwatt.demo.outlets.outlets import Outlets
from cellwatt.demo.outlets.said import CURRENT, POWER
from cellwatt.demo.outlets.table import whole

Make = Callable[..., Outlets]
FRAME = {POWER: 105.7921, CURRENT: -1.98264}
AT = 1_800_000_000_760_000_000
GOOD = {"ok": True, "problems": []}


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Outlets on a PC that has these programs."""

    def made(*installed: str) -> Outlets:
        monkeypatch.setattr(programs, "find", lambda name: f"/usr/bin/{name}" if name in installed else None)
        return Outlets(tmp_path)

    return made


def page(outlets: Outlets, width: int = 80) -> list[str]:
    out = io.StringIO()
    Console(file=out, width=width, height=24).print(whole(outlets, "running"))
    return [line.rstrip() for line in out.getvalue().splitlines()]


def tell(outlets: Outlets) -> None:
    for said in outlets.said:
        values = {POWER: FRAME[POWER]} if said.name == "Prometheus" else FRAME
        said.frame(values, None if said.name == "Prometheus" else AT)
        said.state("green", 6996, 2)
        said.problem = ""
    outlets.compared.look(outlets.said)


def test_the_cell_has_what_the_demo_has_and_its_outlets(make: Make, tmp_path: Path) -> None:
    outlets = make("mosquitto", "prometheus")
    told = cells.environment(tmp_path, "127.0.0.1:1", "127.0.0.1:2", {})
    plain, cell = load(cells.packaged(), told), load(outlets.settings(), told)
    assert set(cell.outlets) == {*plain.outlets, "metrics", "mqtt", "opc_ua"}
    assert list(cell.sources) == list(plain.sources)
    assert list(cell.stages) == list(plain.stages)


def test_what_has_no_program_is_left_out_and_told(make: Make, tmp_path: Path) -> None:
    outlets = make()
    cell = load(outlets.settings(), cells.environment(tmp_path, "127.0.0.1:1", "127.0.0.1:2", {}))
    assert "mqtt" not in cell.outlets, "it would be tried again and again"
    assert {"metrics", "opc_ua"} <= set(cell.outlets)
    assert [said.name for said in outlets.said] == ["OPC UA"]
    tell(outlets)
    shown = "\n".join(page(outlets, 110))
    assert "Prometheus is left out: the program prometheus is not here: apt-get install prometheus" in shown
    assert "there is no broker, as the program mosquitto is not here: apt-get install mosquitto" in shown
    assert outlets.added_to(GOOD, None)["ok"], "nobody must have them"


def test_before_anything_is_told(make: Make) -> None:
    lines = page(make("mosquitto", "prometheus"))
    assert lines[1].split() == ["Prometheus", "MQTT", "OPC", "UA"]
    assert lines[3].split() == [POWER, "–", "–", "–"]
    assert "alarm of the fault" in lines[9] and "not up" not in lines[9]
    assert "nothing is compared yet" in lines
    assert "OPC UA is not reached yet" in lines


def test_the_same_frame_side_by_side(make: Make) -> None:
    outlets = make("mosquitto", "prometheus")
    tell(outlets)
    outlets.said[1].frame({POWER: 99.0, CURRENT: 0.0}, AT + 20_000_000)  # MQTT is ahead
    outlets.open = True
    lines = page(outlets)
    assert lines[2] == "frame of 08:00:00.76"
    assert lines[3].split()[1:] == ["105.7921", "W"] * 3
    assert lines[4].split()[1:] == ["not", "a", "metric", "-1.9826", "A", "-1.9826", "A"]
    assert lines[7].endswith("6 996            6 996            6 996")
    assert lines[9].count("not up") == 3
    assert "1 frames and 1 health messages compared: the same in all" in lines
    assert any("mosquitto_sub -p" in line for line in lines)


def test_it_fits_a_terminal_of_80_by_24(make: Make) -> None:
    outlets = make("mosquitto", "prometheus")
    tell(outlets)
    outlets.open = True
    for said in outlets.said:
        said.alarm(f"{said.name} tells the alarm in {'many ' * 30}words")
    lines = page(outlets)
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    assert lines[9].split()[-3:] == ["up", "up", "up"]
    for name in ("Prometheus", "MQTT", "OPC UA"):
        assert any(line.strip().startswith(f"{name} ") and "tells the alarm" in line for line in lines)


def test_the_summary_of_a_good_run(make: Make) -> None:
    outlets = make("mosquitto", "prometheus")
    tell(outlets)
    for said in outlets.said:
        said.alarm("up")
        said.heard = 1002.5
    found = outlets.added_to(GOOD, 1000.0)
    assert (found["ok"], found["problems"]) == (True, [])
    assert found["outlets"]["alike"] == {"frames": 1, "health": 1}
    assert [told["alarm_after_s"] for told in found["outlets"]["told"].values()] == [2.5, 2.5, 2.5]


def test_the_summary_sees_what_is_wrong(make: Make) -> None:
    outlets = make("mosquitto", "prometheus")
    problems = "; ".join(outlets.added_to(GOOD, None)["problems"])
    assert "Prometheus told no values: it is not reached yet" in problems
    assert "the alarm" not in problems, "the spring did not come"
    tell(outlets)
    assert "the alarm was not seen in MQTT" in outlets.added_to(GOOD, 1000.0)["problems"]
    assert not outlets.added_to({"ok": False, "problems": ["the demo's own"]}, None)["ok"]
    outlets.said[1].frame({POWER: 1.0, CURRENT: 2.0}, AT)
    outlets.said[2].frame({POWER: 1.0, CURRENT: 3.0}, AT)
    outlets.said[0].frame({POWER: 1.0})
    outlets.compared.look(outlets.said)
    assert outlets.added_to(GOOD, None)["problems"] == [f"1 times {CURRENT} was not the same in all outlets"]
    assert f"1 times {CURRENT} was not the same in all" in page(outlets)


def test_outlets_that_have_no_frame_in_common_are_told(make: Make) -> None:
    outlets = make("mosquitto", "prometheus")
    for number, said in enumerate(outlets.said):
        said.frame({POWER: float(number)})
        said.state("green", number, 0)
    outlets.compared.look(outlets.said)
    assert outlets.added_to(GOOD, None)["problems"] == ["no frame, or no health message, was found in all outlets"]


LACKING = """
import sys
sys.modules |= {"aiomqtt": None, "prometheus_client.core": None}
sys.argv = ["cellwatt", "demo", "--outlets"]
from cellwatt.commands import main
main()
"""


def test_every_missing_extra_is_named() -> None:
    done = subprocess.run([sys.executable, "-c", LACKING], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "outlet 'metrics' needs the package prometheus_client.core: pip install 'cellwatt[metrics]'",
        "outlet 'mqtt' needs the package aiomqtt: pip install 'cellwatt[mqtt]'",
    ]


def test_only_the_small_cell_has_outlets() -> None:
    command = [sys.executable, "-m", "cellwatt.commands", "demo", "--cell", "all", "--outlets"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "the outlets are shown with the small cell alone" in done.stderr
