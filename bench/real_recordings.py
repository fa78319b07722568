"""`cellwatt explain` on recordings of real arms: a concealed payload, a balancer nobody told of, an arm that warms.

    python bench/real_recordings.py --json
    python bench/real_recordings.py --story payload --work out

The recordings are looked for in ../shared/data beside the checkout, or where --data says, and then in the folder that
--more or the environment variable CELLWATT_RECORDINGS names, each under the name that its story gives it; a story whose
recordings are absent is skipped, with the reason. ``docs/proof-real.md`` tells what comes out.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from real.product import ExplainError
from real.stories import STORIES

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
MORE = "CELLWATT_RECORDINGS"


def holding(needed: str, folders: Sequence[Path]) -> Path | None:
    """The first of the folders that has the recordings."""
    return next((folder for folder in folders if (folder / needed).exists()), None)


def tell(names: list[str], folders: Sequence[Path], work: Path) -> dict[str, Any]:
    """Figures of each story, or why there are none."""
    out: dict[str, Any] = {}
    for name in names:
        needed, story = STORIES[name]
        if (data := holding(needed, folders)) is None:
            out[name] = {"skipped": f"no recordings in {needed} of {' or '.join(map(str, folders))}"}
            continue
        try:
            out[name] = story(data, work)
        except ExplainError as error:
            out[name] = {"failed": str(error)}
    return out


def show(name: str, figures: dict[str, Any], indent: int = 0) -> None:
    """Findings of a story as text."""
    print("  " * indent + name)
    for key, value in figures.items():
        if key == "findings":
            for finding in value:
                print("  " * (indent + 1) + f"[{finding['kind']}, {finding['confidence']}] {finding['statement']}")
        elif key == "fit":
            for fit in value:
                figures_ = ", ".join(f"{k} {v:.3g}" for k, v in fit.items() if isinstance(v, float))
                print("  " * (indent + 1) + f"{fit['channel']}: {figures_}")
        elif isinstance(value, dict):
            show(key, value, indent + 1)
        else:
            print("  " * (indent + 1) + f"{key}: {value}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object instead of text")
    parser.add_argument("--story", action="append", choices=list(STORIES), help="only these")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--more", type=Path, default=os.environ.get(MORE), help="another folder with recordings")
    parser.add_argument("--work", type=Path, help="keep robots, recordings and reports here")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = options.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        folders = [options.data] if options.more is None else [options.data, options.more]
        result = tell(options.story or list(STORIES), folders, work)
    if options.json:
        print(json.dumps(result, indent=2))
        return
    for name, figures in result.items():
        show(name, figures)


if __name__ == "__main__":
    main()
