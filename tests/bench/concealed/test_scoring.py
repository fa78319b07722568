"""Scores and totals from answers written by hand."""

import sys

import numpy as np
import pytest
from concealed import product
from concealed.page import markdown
from concealed.scoring import comparisons, hold_out, score, strength_of
from concealed.totals import totals, wilson


def finding(effect, joint, **parameters):
    return {"effect": effect, "joint": joint, "kind": "missing",
            "parameters": {k: {"value": v, "std": s} for k, (v, s) in parameters.items()}}  # fmt: skip


def key_of(*effects, level="single"):
    required = [{"effect": e["effect"], "joint": None if e.get("joint") is None else e["joint"] + 1} for e in effects]
    return {"required": required, "effects": list(effects), "level": level, "ratio": 4.0, "runs": [], "allowed": []}


def test_names_are_counted_by_effect_and_joint():
    key = key_of({"effect": "stribeck_friction", "joint": 1}, {"effect": "payload", "joint": None})
    said = [finding("stribeck_friction", 2), finding("torque_offset", 3),
            {"effect": "coulomb_friction", "joint": 1, "kind": "mistuned"}]  # fmt: skip
    s = score(key, said, [], [])
    assert (s["hit"], s["false"], s["missed"], s["exact"]) == (1, 1, 1, False)
    assert (s["joints_found"], s["joints"]) == (1, 1)
    assert score(key_of(), [], [], [])["exact"]


def test_what_is_allowed_is_neither_right_nor_wrong():
    key = key_of({"effect": "backlash", "joint": 1}) | {"allowed": [{"effect": "unknown", "joint": 4}]}
    s = score(key, [finding("backlash", 2), finding("unknown", 4)], [], [])
    assert (s["exact"], s["false"]) == (True, 0)


def test_alternatives_are_listed_not_counted():
    said = [finding("torque_offset", 3) | {"alternatives": [{"effect": "payload", "joint": None}]}]
    assert score(key_of({"effect": "payload", "joint": None}), said, [], [])["listed"] == 1


def test_intervals_are_judged_where_definitions_agree():
    key = key_of({"effect": "payload", "joint": None, "strength": "weak", "mass": 2.0, "com": [0.0, 0.1, 0.2]})
    said = [finding("payload", None, mass=(2.1, 0.1), com_y=(0.3, 0.05), colour=(1.0, 1.0))]
    got = {c["parameter"]: c["covered"] for c in comparisons(key, said)}
    assert got == {"mass": True, "com_y": False}


def test_phase_goes_round_and_a_coefficient_needs_the_same_power():
    cogging = key_of({"effect": "position_periodic_torque", "joint": 0, "amplitude": 1.0, "cycles": 5.0, "phase": 6.2})
    said = [finding("position_periodic_torque", 1, phase=(-0.1, 0.05), cycles=(5.0, 0.01))]
    assert [c["covered"] for c in comparisons(cogging, said)] == [True, True]
    power = key_of({"effect": "nonlinear_viscous_friction", "joint": 0, "coefficient": 1.0, "exponent": 3.0})
    other = [finding("nonlinear_viscous_friction", 1, coefficient=(1.0, 0.1), exponent=(2.0, 0.0))]
    assert [c["parameter"] for c in comparisons(power, other)] == ["exponent"]


def test_gap_is_measured_from_simulation_to_best_possible():
    key = {"runs": [{"run": "holdout_05", "split": "sealed", "rmse_simulation": [3.0, 1.0], "rmse_oracle": [1.0, 1.0],
                     "power_rmse_simulation": 1.0, "power_rmse_oracle": 1.0}]}  # fmt: skip
    flat = lambda size: (np.full((50, 2), size), np.full(50, size))  # noqa: E731
    (row,) = hold_out(key, lambda name: flat(1.5))
    assert (row["channel"], row["gap_closed"]) == ("tau_1", pytest.approx(0.75))
    assert hold_out(key, lambda name: None)[0]["gap_closed"] is None


@pytest.mark.parametrize(
    ("hits", "of", "interval"), [(8, 10, [0.49, 0.943]), (0, 59, [0.0, 0.061]), (17, 28, [0.424, 0.764])]
)
def test_wilson_interval(hits, of, interval):
    assert wilson(hits, of) == pytest.approx(interval, abs=1e-3)


def gap(channel, simulation, model, oracle):
    closed = None if model is None else (simulation - model) / (simulation - oracle)
    return {"channel": channel, "simulation": simulation, "model": model, "oracle": oracle, "gap_closed": closed}


def rows_of_five():
    """A null and an unknown by the law, a null with a false name and two singles of a user's own simulation."""
    gain = {"effect": "torque_gain", "joint": 0, "gain": 0.1}
    entries = [
        ("law", "null", key_of(level="null"), [], []),
        ("law", "unknown", key_of({"effect": "unknown", "joint": 0}), [finding("unknown", 1)], []),
        ("bare", "null", key_of(level="null"), [finding("payload", None)], []),
        ("tool", "single", key_of(gain), [finding("torque_gain", 1, gain=(0.11, 0.01))], [gap("tau_1", 3.0, 1.5, 1.0)]),
        ("tool", "single", key_of(gain), [], [gap("tau_1", 3.0, 4.0, 1.0)]),
    ]
    rows = []
    for kind, level, key, said, gaps in entries:
        s = score(key, said, [], gaps) | {"seconds": 2.0, "error": None, "hold_out_recorded": gaps}
        row = {"id": "case", "level": level, "robot": "r", "ratio": 4.0, "strength": strength_of(key)}
        rows.append(row | s | {"simulation": {"kind": kind}})
    return rows


def test_figures_are_split_by_whose_the_simulation_is():
    t = totals(rows_of_five())
    law, own, tool = t["by_simulation"]["law"], t["by_simulation"]["own"], t["by_kind"]["tool"]
    assert (law["cases"], law["f1"], law["null_false_rate"]["hits"], law["channels"]) == (2, 1.0, 0, 0)
    assert (own["cases"], own["f1"], own["null_false_rate"]["hits"]) == (3, 0.5, 1)
    assert own["unknown_recall"]["of"] == 0
    assert (tool["cases"], tool["recall"]["value"], tool["channels"], tool["channels_made_worse"]) == (2, 0.5, 2, 1)
    assert tool["gap_closed_median"] == tool["gap_closed_recorded_median"] == pytest.approx(0.125)
    assert t["by_kind"]["bare"]["f1"] is None
    result = {"cases": 5, "nulls": 2, "totals": t, "failures": []}
    lines = markdown(result).splitlines()
    assert "|  | all | robot.yaml's law | own simulation |" in lines
    assert next(x for x in lines if x.startswith("| (b) ")).startswith(
        "| (b) simulation and arm have a tool that the URDF lacks | 2 | 0.667 | 0.500 (0.10–0.91; 1/2) |"
    )


def test_a_product_that_is_stopped_from_outside_gave_no_answer(tmp_path):
    stops = "import os, signal; os.kill(os.getpid(), signal.SIGTERM)"
    with pytest.raises(product.StoppedError):
        product.explain(f"{sys.executable} -c '{stops}'", tmp_path, tmp_path / "out")


def test_a_failing_product_is_an_error_of_its_case(tmp_path):
    got = product.explain(f"{sys.executable} -c 'raise SystemExit(3)'", tmp_path, tmp_path / "out")
    assert got.error
    assert got.findings == []
