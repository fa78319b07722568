"""Simulations of the user's own, against the description's law written anew on the files that a case consists of."""

from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from concealed import setting
from concealed.cases import Spec, make_case, specs
from concealed.files import group
from concealed.own import KNOWABLE, OWN

pin = pytest.importorskip("pinocchio")

DRIVES = ("coulomb_friction", "viscous_friction", "rotor_inertia", "winding_resistance", "torque_constant")
SHORT = setting.RunSet((("excite", 12), ("task", 12)), (("excite", 6),), (100,), 0.001, 0.004)


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """Makes a case of a kind once: its folder, its keys' folder and its key."""
    made = {}

    def case(kind: str, *effects: tuple[str, str]):
        if (kind, effects) not in made:
            work = tmp_path_factory.mktemp(kind)
            with pytest.MonkeyPatch.context() as patch:
                patch.setitem(setting.RUN_SETS, "short", SHORT)
                key = make_case("y", 0, Spec("single" if effects else "null", effects, "short", False, kind), work)
            made[kind, effects] = work / "dev" / "case-001", work / "keys" / "case-001", key
        return made[kind, effects]

    return case


def columns(file: Path, name: str) -> np.ndarray:
    return group(pq.read_table(file), name)


class Described:
    """What robot.yaml and URDF of a case say, as the contract writes the law."""

    def __init__(self, case: Path) -> None:
        spec = yaml.safe_load((case / "robot.yaml").read_text())
        self.model = pin.buildModelFromUrdf(str(case / "robot.urdf"))
        self.of = {k: np.array([j.get(k, 0.0) for j in spec["joints"]]) for k in DRIVES}
        self.standby = spec.get("standby_power", 0.0)
        self.joints = spec["joints"]

    def torque(self, q, v, a):
        data = self.model.createData()
        rigid = np.array([pin.rnea(self.model, data, *x) for x in zip(q, v, a, strict=True)])
        friction = self.of["coulomb_friction"] * np.tanh(v / 0.004) + self.of["viscous_friction"] * v
        return rigid + self.of["rotor_inertia"] * a + friction

    def power(self, torque, v):
        copper = self.of["winding_resistance"] * (torque / self.of["torque_constant"]) ** 2
        return self.standby + np.sum(torque * v + copper, axis=1)


def told(case: Path, run: str = "run_01"):
    """q, qd, qdd, tau (N, n) and power (N,) of a simulation, and the described law on the same motion."""
    file = case / f"{run}.simulation.parquet"
    q, v, a, tau = (columns(file, c) for c in ("q", "qd", "qdd", "tau"))
    law = Described(case)
    return q, v, a, tau, pq.read_table(file)["power"].to_numpy().astype(float), law


def share(x: np.ndarray, y: np.ndarray) -> float:
    """Least-squares factor of y in x."""
    return float(np.sum(x * y) / np.sum(y * y))


def rms(x: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(x), axis=0))


def test_half_of_every_level_is_the_users_own_and_all_kinds_come():
    drawn = specs("y")
    for level in {s.level for s in drawn}:
        own = [s.simulation != "law" for s in drawn if s.level == level]
        assert abs(np.mean(own) - 0.5) <= 0.5 / len(own) + 1e-9
    counts = Counter(s.simulation for s in drawn)
    assert set(counts) == {"law", *OWN}
    assert min(counts.values()) >= 8
    for s in drawn:
        assert s.simulation != "known" or KNOWABLE & {e for e, _ in s.effects}


def test_a_simulation_by_the_law_is_the_description(cases):
    case, _, key = cases("law")
    q, v, a, tau, power, law = told(case)
    assert key["simulation"] == {"kind": "law"}
    assert np.abs(tau - law.torque(q, v, a)).max() < 1e-4 * np.abs(tau).max()
    assert np.allclose(power, law.power(tau, v), rtol=1e-4)


@pytest.mark.parametrize(
    "kind", ["bare", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("tool", "off", "term"))]
)
def test_a_null_has_nothing_but_the_description_is_far_away(cases, kind):
    case, _, key = cases(kind)
    noise = np.array(key["runs"][0]["noise"])
    left, off = [], []
    for run in ("run_01", "run_02"):
        q, v, a, tau, power, law = told(case, run)
        measured = columns(case / f"{run}.recording.parquet", "tau")
        moving = np.abs(v) > 0.02
        left.append((measured - tau) * moving)
        off.append(np.column_stack([(tau - law.torque(q, v, a)) / noise, (power - law.power(tau, v))]))
    assert key["required"] == []
    assert (rms(np.concatenate(left)) / noise).max() < 5.0
    assert rms(np.concatenate(off)).max() > 5.0
    assert max(max(np.array(r["effect_rms"]) / noise) for r in key["runs"]) < 1.0
    assert max(r["power_effect_rms"] / r["power_noise"] for r in key["runs"]) < 1.0


def test_bare_description_knows_no_drives(cases):
    case, _, key = cases("bare")
    law = Described(case)
    assert not any(law.of[k].any() for k in law.of if k != "torque_constant")
    assert law.standby == 0.0
    assert ("coulomb_friction" not in law.joints[0]) == key["simulation"]["keys_left_out"]


def test_tool_of_the_simulation_weighs_what_the_key_says(cases):
    case, _, key = cases("tool")
    q, v, a, tau, _, law = told(case)
    still = (np.abs(v).max(axis=1) < 1e-4) & (np.abs(a).max(axis=1) < 1e-3)
    q, zero = q[still][:1], np.zeros_like(q[:1])
    bare = law.torque(q, zero, zero)
    last = law.model.njoints - 1
    law.model.inertias[last] += pin.Inertia(
        key["simulation"]["mass"], np.array(key["simulation"]["com"]), np.zeros((3, 3))
    )
    weight = law.torque(q, zero, zero) - bare
    assert np.abs(weight).max() > 0.1
    assert np.allclose(tau[still][:1] - bare, weight, atol=0.1 * np.abs(weight).max())


def test_figures_of_the_description_are_off_by_the_factors_of_the_key(cases):
    case, _, key = cases("off")
    factors = key["simulation"]["factors"]
    assert abs(factors["coulomb"] - 1) > 0.25
    assert abs(factors["viscous"] - 1) > 0.2
    q, v, a, tau, _, law = told(case)
    rest = tau - law.torque(q, v, a)
    j = int(np.argmax(rms(v)))
    shapes = np.stack([np.tanh(v[:, j] / 0.004), v[:, j], a[:, j], np.sin(q[:, j]), np.cos(q[:, j])], axis=1)
    more = np.linalg.lstsq(shapes, rest[:, j], rcond=None)[0]
    for k, (name, factor) in enumerate((("coulomb_friction", "coulomb"), ("viscous_friction", "viscous"))):
        assert law.of[name][j] / (law.of[name][j] + more[k]) == pytest.approx(factors[factor], rel=0.15)


def test_what_the_description_knows_is_what_the_simulation_leaves_out(cases):
    case, _, key = cases("known", ("viscous_friction", "strong"))
    (truth,) = key["effects"]
    j, expected = truth["joint"], truth["coefficient"]
    q, v, a, tau, _, law = told(case)
    assert law.of["viscous_friction"][j] == pytest.approx(expected, rel=0.15)
    missing = law.torque(q, v, a)[:, j] - tau[:, j]
    assert share(missing, v[:, j]) == pytest.approx(expected, rel=0.25)
    measured = columns(case / "run_01.recording.parquet", "tau")[:, j]
    assert share(measured - tau[:, j], v[:, j]) == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize("effect", ["payload", pytest.param("link_inertial_error", marks=pytest.mark.slow)])
def test_a_mass_that_the_description_knows_explains_the_recording(cases, effect):
    case, _, key = cases("known", (effect, "strong"))
    q, v, a, tau, _, law = told(case)
    measured = columns(case / "run_01.recording.parquet", "tau")
    noise = np.array(key["runs"][0]["noise"])
    missing = rms(measured - tau) / noise
    j = int(np.argmax(missing))
    known = law.torque(q, v, a) - tau
    assert missing[j] > 2.0
    assert share((measured - tau)[:, j], known[:, j]) == pytest.approx(1.0, abs=0.3)


def test_terms_of_the_simulation_are_those_of_the_key(cases):
    case, _, key = cases("term")
    q, v, a, tau, power, law = told(case)
    rest, supplied = tau - law.torque(q, v, a), power
    expected, drive = np.zeros_like(rest), law.power(tau, v) - law.standby
    for term in key["simulation"]["terms"]:
        j, sign = term["joint"], np.tanh(v / 0.004)
        if term["term"] == "stribeck_friction":
            expected[:, j] += term["excess"] * np.exp(-((v[:, j] / term["velocity"]) ** 2)) * sign[:, j]
        elif term["term"] == "load_dependent_friction":
            zero = law.of["coulomb_friction"] * sign + law.of["viscous_friction"] * v + law.of["rotor_inertia"] * a
            expected[:, j] += term["coefficient"] * np.abs((law.torque(q, v, a) - zero)[:, j]) * sign[:, j]
        elif term["term"] == "iron_loss":
            drive = drive + np.abs(v) @ term["hysteresis"] + v**2 @ np.array(term["eddy"])
        else:
            drive = np.where(drive > 0, drive / term["efficiency"], drive * term["efficiency"])
    noise = np.array(key["runs"][0]["noise"])
    assert (rms(rest - expected) / noise).max() < max(0.1, 0.06 * (rms(expected) / noise).max())
    extra = rms(law.power(tau, v) - power)
    assert rms(law.standby + drive - supplied) < max(0.05, 0.1 * extra)
