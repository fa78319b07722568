"""The user's file is the arm that the benchmark's law describes; figures and tables are those of what was measured."""

import sys
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from concealed.arms import draw_arm, mistune
from concealed.cases import generator
from concealed.families import FAMILIES
from concealed.law import joint_torque
from mend import arms, judge, numbers, runner

from tests.bench.independent import assert_shares_no_code


def model_of(family, arm):
    return mujoco.MjModel.from_xml_string(arms.mjcf(generator("x", family), arm))


def test_shares_no_code_with_the_product(bench):
    assert_shares_no_code(bench / "mend")


@pytest.mark.parametrize("family", FAMILIES)
def test_the_users_file_is_the_arm_in_frames_of_its_own(family):
    arm = draw_arm(np.random.default_rng(3), family)
    q, v, a = np.random.default_rng(0).normal(size=(3, 5, arm.joints))
    expected = joint_torque(arm, q, v, a)
    torque = judge.torque(model_of(family, arm), q, v, a)
    np.testing.assert_allclose(torque, expected, rtol=1e-5, atol=5e-4)


def test_errors_are_measured_less_simulated():
    arm = draw_arm(np.random.default_rng(3), "compact6")
    q, v, a = np.random.default_rng(0).normal(size=(3, 50, 6))
    model = model_of("compact6", arm)
    shifted = judge.Motion(q, v, a, joint_torque(arm, q, v, a) + np.array([0, 0, 2.0, 0, 0, 0]))
    np.testing.assert_allclose(judge.error(model, [shifted]), [0, 0, 2.0, 0, 0, 0], atol=1e-4)


def test_numbers_that_are_off_are_found_where_they_are():
    arm = draw_arm(np.random.default_rng(3), "compact6")
    model = model_of("compact6", arm)
    assert numbers.off(model, arm)["worst"] < 0.01
    model.dof_damping[3] *= 1.2
    found = numbers.off(model, arm)
    assert (found["where"], round(found["worst"], 1)) == ("damping 4", 20.0)
    assert found["median"] < 0.01


def test_an_explanation_that_fails_ends_the_benchmark(tmp_path):
    drawn = SimpleNamespace(folder=tmp_path, case=arms.CASES[0])
    with pytest.raises(SystemExit, match="payload-spring-stribeck: broken"):
        runner.product(drawn, f"""{sys.executable} -c "raise SystemExit('broken')" """)


def test_the_peer_finds_numbers_that_are_off():
    """Nothing is missing and nothing is noisy: its friction, damping and armature come out."""
    sysid = pytest.importorskip("mujoco.sysid", reason="this MuJoCo has no sysid toolbox")
    if not hasattr(sysid, "ParameterDict"):
        pytest.skip("this MuJoCo's sysid toolbox is incomplete: pip install 'mujoco[sysid]'")
    peer = pytest.importorskip("mend.peer", reason="mujoco.sysid is not installed")
    arm = draw_arm(np.random.default_rng(3), "compact6")
    believed = model_of("compact6", mistune(np.random.default_rng(5), arm))
    rng = np.random.default_rng(0)
    q, v, a = rng.uniform(-2, 2, (400, 6)), rng.uniform(-2, 2, (400, 6)), rng.uniform(-6, 6, (400, 6))
    run = judge.Motion(q, v, a, joint_torque(arm, q, v, a))
    spec = mujoco.MjSpec.from_string(arms.mjcf(generator("x", "compact6"), mistune(np.random.default_rng(5), arm)))
    found = peer.identified(spec, [run], arm.noise)
    assert np.all(judge.error(found, [run]) < 0.5 * judge.error(believed, [run]))
