"""`cellwatt explain` on real arms, judged on motion that it did not see, beside a plain regression.

    python bench/real_unseen.py
    python bench/real_unseen.py --case ur10e-urdf --json
    python bench/real_unseen.py --logger loop

Prints, per arm, the error of the simulation, of the explained model and of the regression on the unseen motion (root
mean square over joints, each in units of its torque's spread), the names and the seconds; of the UR3e, the error of its
supply power. Recordings are looked for as ``real_recordings.py`` does.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path

from real import supply
from real.logged import LOGGERS
from real.product import ExplainError
from real.unseen import CASES, judged
from real_recordings import DATA, MORE, holding

POWER = "ur3e-power"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object a line instead of text")
    parser.add_argument("--case", action="append", choices=[*CASES, POWER], help="only these")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--more", type=Path, default=os.environ.get(MORE), help="another folder with recordings")
    parser.add_argument("--time", type=float, default=50.0, help="seconds that explain may compute")
    parser.add_argument("--logger", choices=LOGGERS, default="source", help="how the seen recordings were logged")
    parser.add_argument("--work", type=Path, help="keep robots, recordings and models here")
    options = parser.parse_args()
    folders = [options.data] if options.more is None else [options.data, options.more]
    with tempfile.TemporaryDirectory() as temporary:
        for name in options.case or [*CASES, POWER]:
            needed = supply.FOLDER if name == POWER else CASES[name][0]
            work = (options.work or Path(temporary)) / name
            result = {"case": name}
            if (data := holding(needed, folders)) is None:
                result |= {"skipped": f"no recordings in {needed} of {' or '.join(map(str, folders))}"}
            else:
                try:
                    result |= (
                        supply.supply(data, work)
                        if name == POWER
                        else judged(CASES[name][1](data, work), options.time, options.logger)
                    )
                except ExplainError as error:
                    result |= {"failed": str(error)}
            print(json.dumps(result) if options.json else told(result), flush=True)


def told(result: dict) -> str:
    """One case as text."""
    if "power_error" in result:
        errors = ", ".join(f"{name} {value} W" for name, value in result["power_error"].items())
        refused = [f"  without {move}: {why}" for move, why in result["refused"].items()]
        named = [f"  without {move}: {statement}" for move, all_ in result["named"].items() for statement in all_]
        return "\n".join([f"{result['case']}: {errors}; {result['seconds']:.0f} s", *refused, *named])
    if "error" not in result:
        return f"{result['case']}: {result.get('skipped') or result['failed']}"
    whole = ", ".join(f"{name} {value:.3f}" for name, value in result["over_spread"].items())
    lines = [f"{result['case']}: {whole}; {result['to_regression']:.2f} x the regression; {result['seconds']:.0f} s"]
    lines += [f"  {name:<10} Nm  " + "  ".join(f"{e:8.3f}" for e in values) for name, values in result["error"].items()]
    lines += [f"  worse than the simulation at joints {result['worse_at_joints']}"] * bool(result["worse_at_joints"])
    lines += [f"  [{f['kind']}, {f['confidence']}] {f['statement']}" for f in result["findings"]]
    return "\n".join([*lines, *(f"  {said}" for said in result["unexplained"])])


if __name__ == "__main__":
    main()
