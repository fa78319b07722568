"""Every model of the papers beside the best one: the tables and plots of docs/models.md.

    python bench/models.py --json [--only static ur3e …]     # the figures
    python bench/models.py [--only …]                        # writes the page and its pictures, which takes a browser

The parts ``ur3e`` and ``ur10e`` need recordings, looked for in ../shared/data beside the checkout or where --data says;
without them they are skipped, with the reason. All of it takes some twenty minutes of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from models import epochs, page, power, static, ur3e, ur10e
from real import ur10e as recorded
from real.browser import drawn

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
DOCS = ROOT / "docs"


Told = tuple[Any, str, Mapping[str, Mapping[str, Any]]]
"""What a part gives: figures, the text of the page, and pictures by name."""


def _static(_: Path, __: Path) -> Told:
    tables, first = static.run()
    return tables, page.static(tables), static.pictures(tables, first)


def _epochs(_: Path, __: Path) -> Told:
    tables = epochs.run()
    return tables, page.epochs(tables), {"static-epochs": epochs.picture(tables)}


def _power(_: Path, work: Path) -> Told:
    errors = power.emulated(work)
    return errors, page.power(errors), {}


def _curve(_: Path, work: Path) -> Told:
    sizes = power.learning_curve(work)
    return sizes, page.curve(sizes), {"power-learning": power.learning_picture(sizes)}


def _ur3e(data: Path, work: Path) -> Told:
    trained, moves = power.trained_ur3e(data, work)
    errors = power.errors_ur3e(trained, moves)
    return errors, page.ur3e(errors), {"ur3e-power": power.measured_and_predicted(trained, moves)}


def _ur10e(data: Path, work: Path) -> Told:
    currents = ur10e.currents(data, work)
    return currents, page.ur10e(currents), {}


def _speed(_: Path, work: Path) -> Told:
    found = power.speed(work)
    return found, page.speed(found), {}


PARTS: Mapping[str, Callable[[Path, Path], Told]] = {
    "static": _static,
    "epochs": _epochs,
    "power": _power,
    "curve": _curve,
    "ur3e": _ur3e,
    "ur10e": _ur10e,
    "speed": _speed,
}
"""Each is given the folders of the recordings and for scratch."""
NEEDS = {"ur3e": ur3e.FOLDER, "ur10e": recorded.FOLDER}
"""Folders of the recordings without which a part is skipped."""


def write(name: str, text: str, pictures: Mapping[str, Mapping[str, Any]]) -> None:
    """The part's place on the page, and its pictures."""
    page.replace(DOCS / "models.md", name, text)
    for picture, svg in (drawn(pictures) if pictures else {}).items():
        (DOCS / "pictures" / f"models-{picture}.svg").write_text(svg)


def plain(figures: Any) -> Any:
    """Data classes as JSON takes them."""
    if is_dataclass(figures) and not isinstance(figures, type):
        return asdict(figures)
    return [plain(each) for each in figures] if isinstance(figures, tuple) else figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print the figures and leave the page alone")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="PART")
    parser.add_argument("--data", type=Path, default=DATA)
    given = parser.parse_args()
    figures = {}
    for name in given.only:
        if name in NEEDS and not (given.data / NEEDS[name]).exists():
            figures[name] = {"skipped": f"no recordings in {given.data / NEEDS[name]}"}
            continue
        with tempfile.TemporaryDirectory() as work:
            found, text, pictures = PARTS[name](given.data, Path(work))
        figures[name] = plain(found)
        if not given.json:
            write(name, text, pictures)
        print(f"{name}: done", file=sys.stderr, flush=True)
    if given.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
