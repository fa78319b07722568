"""All arms: drawn, explained and mended, judged on sealed runs; the peer beside it."""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from concealed.arms import Array
from concealed.product import LIMIT, call, default_command, explain_words

from mend import judge
from mend.arms import CASES, Case, Drawn, draw
from mend.numbers import off
from mend.page import markdown


def product(drawn: Drawn, command: str) -> dict[str, Any]:
    """`explain --mend` on the open runs; its findings."""
    out = drawn.folder / "out"
    words = [*explain_words(command, drawn.folder, out), "--mend", str(drawn.folder / "arm.xml")]
    if (failed := call(words, LIMIT)) is not None:
        raise SystemExit(f"{drawn.case.name}: {failed}")
    return dict(json.loads((out / "findings.json").read_text()))


def per_noise(error: Array, noise: Array) -> float:
    """Errors (n,) of all joints as one figure: rms in units of each joint's noise."""
    return float(np.sqrt(np.mean(np.square(error / noise))))


def measure(case: Case, work: Path, command: str, with_peer: bool) -> dict[str, Any]:
    """One arm: errors of all joints on sealed runs, and how far the joints' numbers are off."""
    drawn = draw(case, work)
    found = product(drawn, command)
    joints = drawn.truth.joints
    runs = {split: [r for r in drawn.key["runs"] if r["split"] == split] for split in ("open", "sealed")}
    seen = [judge.motion(drawn.folder, r["run"], joints) for r in runs["open"]]
    sealed = [judge.motion(drawn.sealed, r["run"], joints) for r in runs["sealed"]]
    files = {"before": drawn.folder / "arm.xml", "mended": drawn.folder / "out" / "arm.mended.xml"}
    models = {name: mujoco.MjModel.from_xml_path(str(file)) for name, file in files.items()}
    noise = drawn.truth.noise
    if with_peer:
        from mend import peer

        models["sysid"] = peer.identified(mujoco.MjSpec.from_file(str(drawn.folder / "arm.xml")), seen, noise)
    floor = np.sqrt(np.mean(np.square([r["rmse_oracle"] for r in runs["sealed"]]), axis=0))
    errors = {name: judge.error(model, sealed) for name, model in models.items()}
    names = [r["run"] for r in runs["sealed"]]
    errors["model"] = judge.error_of_model(command, drawn.folder / "out", drawn.sealed, names, sealed)
    soft = {name: per_noise(judge.error(model, sealed, soft=True), noise) for name, model in models.items()}
    return {
        "robot": drawn.truth.family,
        "required": drawn.key["required"],
        "found": [{"effect": f["effect"], "joint": f["joint"], "kind": f["kind"]} for f in found["findings"]],
        "left": found["mended"]["left"],
        "own": found["mended"]["error"],
        "noise": noise.tolist(),
        "floor": floor.tolist(),
        "errors": {name: error.tolist() for name, error in errors.items()},
        "in_noise": {name: round(per_noise(error, noise), 3) for name, error in {**errors, "floor": floor}.items()},
        "in_noise_soft": {name: round(value, 3) for name, value in soft.items()},
        "numbers": {name: off(model, drawn.truth) for name, model in models.items()},
    }


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print all figures instead of the page's tables")
    parser.add_argument("--work", type=Path, help="folder to keep the cases in")
    parser.add_argument("--only", nargs="+", choices=[c.name for c in CASES], help="only these arms")
    parser.add_argument("--command", default=default_command(), help="how to call cellwatt")
    parser.add_argument("--no-peer", action="store_true", help="leave out mujoco.sysid")
    words = parser.parse_args()
    chosen = [c for c in CASES if not words.only or c.name in words.only]
    with tempfile.TemporaryDirectory() as scratch:
        work = words.work or Path(scratch)
        figures = {c.name: measure(c, work, words.command, not words.no_peer) for c in chosen}
    print(json.dumps(figures) if words.json else markdown(figures))
