"""Every model of the papers beside the best one: the tables and plots of docs/models.md.

    python bench/models.py --json [--only static ur3e …]     # the figures
    python bench/models.py [--only …]                        # writes the page and its pictures

The parts ``ur3e`` and ``ur10e`` need recordings, looked for in ../shared/data beside the checkout or where --data says;
without them they are skipped, with the reason. All of it takes some twenty minutes of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

from models import epochs, page, power, static, ur3e, ur10e
from models.svg import drawn
from real import ur10e as recorded

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
DOCS = ROOT / "docs"


@dataclass(frozen=True)
class Told:
    """What a part gives: figures, the text of the page, and pictures by name."""

    figures: Any
    text: str
    pictures: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Part:
    """``make`` is given the folders of the recordings and for scratch; ``needs`` is a folder of the recordings."""

    make: Callable[[Path, Path], Told]
    needs: str | None = None


def _static(_: Path, __: Path) -> Told:
    tables, first = static.run()
    return Told(tables, page.static(tables), static.pictures(tables, first))


def _epochs(_: Path, __: Path) -> Told:
    tables = epochs.run()
    return Told(tables, page.epochs(tables), {"static-epochs": epochs.picture(tables)})


def _power(_: Path, work: Path) -> Told:
    errors = power.emulated(work)
    return Told(errors, page.power(errors))


def _curve(_: Path, work: Path) -> Told:
    sizes = power.learning_curve(work)
    return Told(sizes, page.curve(sizes), {"power-learning": power.learning_picture(sizes)})


def _ur3e(data: Path, work: Path) -> Told:
    trained, moves = power.trained_ur3e(data, work)
    errors = power.errors_ur3e(trained, moves)
    return Told(errors, page.ur3e(errors), {"ur3e-power": power.measured_and_predicted(trained, moves)})


def _ur10e(data: Path, work: Path) -> Told:
    currents = ur10e.currents(data, work)
    return Told(currents, page.ur10e(currents))


def _speed(_: Path, work: Path) -> Told:
    found = power.speed(work)
    return Told(found, page.speed(found))


PARTS: Mapping[str, Part] = {
    "static": Part(_static),
    "epochs": Part(_epochs),
    "power": Part(_power),
    "curve": Part(_curve),
    "ur3e": Part(_ur3e, ur3e.FOLDER),
    "ur10e": Part(_ur10e, recorded.FOLDER),
    "speed": Part(_speed),
}


def write(name: str, told: Told) -> None:
    """The part's place on the page, and its pictures."""
    page.replace(DOCS / "models.md", name, told.text)
    for picture, figure in told.pictures.items():
        (DOCS / "pictures" / f"models-{picture}.svg").write_text(drawn(figure))


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
        part = PARTS[name]
        if part.needs and not (given.data / part.needs).exists():
            figures[name] = {"skipped": f"no recordings in {given.data / part.needs}"}
            continue
        with tempfile.TemporaryDirectory() as work:
            told = part.make(given.data, Path(work))
        figures[name] = plain(told.figures)
        if not given.json:
            write(name, told)
        print(f"{name}: done", file=sys.stderr, flush=True)
    if given.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
