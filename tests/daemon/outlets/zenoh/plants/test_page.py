"""The commands and configurations of docs/plants.md, as they are printed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import zenoh

from tests.daemon.outlets.zenoh.plants import site


def test_zenoh_takes_the_configurations_and_their_files_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site.make(tmp_path)
    for folder, router, extra in (("hq", site.HQ_ROUTER, {}), ("plant-1", site.PLANT_ROUTER, site.uplink(1))):
        monkeypatch.chdir(tmp_path / folder)
        (file,) = re.findall(r"--config (\S+)", router)
        config = zenoh.Config.from_file(file)
        for path, value in extra.items():
            config.insert_json5(path, json.dumps(value))
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
