"""The commands and configurations of docs/plants.md, as they are printed."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import zenoh

from cellwatt.commands.secure import command
from tests.calling import called
from tests.daemon.outlets.zenoh.plants import site
from tests.daemon.outlets.zenoh.plants.network import hq_address

PAGE = (site.ROOT / "docs" / "plants.md").read_text()
HEADQUARTERS, PLANT, HQ_ROUTER, PLANT_ROUTER = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)[:4]


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Runs the commands of the page in a folder."""
    for block in (HEADQUARTERS, PLANT):
        monkeypatch.chdir(tmp_path)
        for line in block.splitlines():
            words = shlex.split(line)
            if words[0] == "cd":
                monkeypatch.chdir(tmp_path / words[1])
            elif words[0] == "cellwatt":
                called(command, *words[2:])
            else:
                subprocess.run(line, shell=True, check=True)
    shutil.copy(site.ROOT / "examples" / "plants" / "hq.json5", tmp_path / "hq")
    return tmp_path


def changes() -> dict[str, str]:
    """What the page puts on the command line of a plant's router."""
    return dict(re.findall(r"--cfg '([\w/]+):(.*?)'", PLANT_ROUTER))


def test_the_page_names_what_the_tests_run(made: Path) -> None:
    shown = {path: json.loads(text.replace("hq.example.com", hq_address(1))) for path, text in changes().items()}
    assert shown == site.uplink(1)
    ours = made / "ours"
    site.make(ours)
    for theirs, mine in ((made / "hq", ours / "hq"), (made / "plant-1", ours / "plant1")):
        assert names(theirs) == names(mine)


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def test_zenoh_takes_the_configurations_and_their_files_exist(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder, router, extra in (("hq", HQ_ROUTER, {}), ("plant-1", PLANT_ROUTER, changes())):
        monkeypatch.chdir(made / folder)
        (file,) = re.findall(r"--config (\S+)", router)
        config = zenoh.Config.from_file(file)
        for path, value in extra.items():
            config.insert_json5(path, value)
        tls = json.loads(config.get_json("transport/link/tls"))
        files = [value for option, value in tls.items() if str(value).endswith(".pem")]
        assert len(files) == 3 + 2 * bool(extra)
        assert all(Path(name).is_file() for name in files), files
        assert json.loads(config.get_json("access_control"))["default_permission"] == "deny"


def test_headquarters_lets_each_plant_speak_for_itself_alone() -> None:
    config = zenoh.Config.from_file(str(site.ROOT / "examples" / "plants" / "hq.json5"))
    control = json.loads(config.get_json("access_control"))
    rules = {rule["id"]: rule for rule in control["rules"]}
    for policy in control["policies"]:
        for subject in policy["subjects"]:
            own = [rules[r] for r in policy["rules"]]
            spoken = {k for r in own if "put" in r["messages"] and r["flows"] == ["ingress"] for k in r["key_exprs"]}
            plant = subject.removesuffix("-router")
            due = {f"cellwatt/{plant}/**", f"cellwatt/{plant}/*/@/**"} if subject != plant else set()
            assert spoken == due, subject
