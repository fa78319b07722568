"""Makes one evidence pack: ``python -m cellwatt.runtime.evidence.making NOTE``, started by the daemon."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

import click

from cellwatt.door.signing import Signer
from cellwatt.errors import CellwattError, why
from cellwatt.record import Recording, packs, seal
from cellwatt.record.cut import Cut, cut
from cellwatt.record.packs import Due
from cellwatt.runtime.evidence.page import report


@click.command()
@click.argument("note", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--reserve", default=0.0, help="Bytes of the disk to leave free.")
@click.option("--sign", type=click.Path(path_type=Path), help="Private key that signs the pack.")
def main(note: Path, reserve: float, sign: Path | None) -> None:
    """Cut the pack that NOTE asks for out of the record and write its page; say what was made as JSON."""
    try:
        due = packs.read_due(note)
        made = make(note.parent, due, reserve)
        problem = _page(due, made)
        if sign is not None:
            seal.write(made.path, "closed", Signer(sign))
    except (CellwattError, OSError, ValueError) as error:
        click.echo(why(error) if isinstance(error, OSError) else str(error), err=True)
        sys.exit(1)
    plain = {key: value for key, value in asdict(made).items() if key in ("start", "end", "messages", "size", "lost")}
    click.echo(json.dumps({**plain, "problem": problem}))


def make(folder: Path, due: Due, reserve: float = 0.0) -> Cut:
    """Cut a pack into ``folder``, which stands in that of the record. Raises ``RecordingError``."""
    return cut(folder.parent, due.cell, due.start, due.end, folder / f"{due.name}.mcap", reserve=reserve)


def _page(due: Due, made: Cut) -> str:
    """Write the page; gives why there is none: the pack is worth keeping without."""
    try:
        report(Recording.open(made.path), due, made).write(packs.page_of(made.path))
    except CellwattError as error:
        return f"the page of {made.path.name} cannot be made: {error}"
    return ""


if __name__ == "__main__":
    main()
