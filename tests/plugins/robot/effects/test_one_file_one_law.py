"""A law of friction that is one more file is known to all four commands that can use it."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cellwatt_plugins
from tests.docs.pages import blocks

ROOT = Path(__file__).resolve().parents[4]

(BLOCK,) = blocks(ROOT / "CONTRIBUTING.md", "python")
LAW = f"""
from types import MappingProxyType

import numpy as np

from cellwatt_plugins.robot.effects.declaration import Acceptance
from cellwatt_plugins.robot.effects.friction import Friction


{BLOCK.text}"""
"""The page's class in a module of its own."""

SCRIPT = """
import json, sys
import numpy as np
from pathlib import Path
from cellwatt_plugins.energy.rigid import LAWS
from cellwatt_plugins.faults.cycles.arm import Motion, nominal
from cellwatt_plugins.faults.cycles.load import load_of, unsure_friction
from cellwatt_plugins.explain.explain import explain
from cellwatt_plugins.explain.input.admission import admit
from cellwatt_plugins.models.power.terms import EFFECTS, TORQUE
from cellwatt_plugins.models.power.terms import Motion as Seen
from tests.plugins.explain import plant

def ground(t, q, qd, run):
    w = qd[:, 1]
    return plant.column(4 * np.exp(-(((np.abs(w) - 0.5) / 0.12) ** 2)) * plant.turned(w), 2)

arm = plant.load(plant.write_robot(Path(sys.argv[1])))
runs = [plant.record(f"run_0{i}", i, plant.Missing(added=ground)) for i in (1, 2)]
(found,) = explain(runs, admit(runs, arm)).findings.findings
w = np.array([[-0.5], [0.02], [0.5]])
seen = Seen(0 * w, w, 0 * w, 0 * w + 1, np.sign(w))
still = np.zeros((3, 3))
load = load_of(arm.body, nominal(arm), Motion(still, w + still, still))
json.dump({
    "explain": [found.effect, found.joint, found.parameters["torque"].value],
    "train power": TORQUE[EFFECTS["friction that grinds"][0]](seen).ravel().tolist(),
    "disaggregate": "grinding_friction" in LAWS,
    "faults": unsure_friction(load, 1, np.full(3, 2.0)).tolist(),
}, sys.stdout)
"""


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """What the four know, in a copy of the plugins that has one file more."""
    folder = tmp_path_factory.mktemp("law")
    shutil.copytree(Path(cellwatt_plugins.__file__).parent, folder / "plugins" / "cellwatt_plugins")
    (folder / "plugins/cellwatt_plugins/robot/effects/friction/grinding_friction.py").write_text(LAW)
    paths = [folder / "plugins", ROOT, *(ROOT / part for part in ("daemon", "drivers"))]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths)), "OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", SCRIPT, folder], env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_explain_names_it_at_the_joint_with_its_size(known):
    effect, joint, torque = known["explain"]
    assert (effect, joint) == ("grinding_friction", 2)
    assert torque == pytest.approx(4.0, rel=0.1)


def test_train_power_tries_it(known):
    assert known["train power"] == pytest.approx([-1.0, 0.0, 1.0], abs=1e-6)


def test_disaggregate_fits_it(known):
    assert known["disaggregate"]


def test_faults_allows_for_it_in_a_sound_joint(known):
    """2 Nm of friction, a tenth of which may follow the law: at -0.5, 0.02 and 0.5 rad/s."""
    columns = [list(column) for column in zip(*known["faults"], strict=True)]
    assert any(column == pytest.approx([0.2, 0.0, 0.2], abs=1e-4) for column in columns)
