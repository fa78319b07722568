"""``python -m fuzz TARGET --minutes 10 --corpus DIR`` searches, ``--keep`` takes the best inputs into fuzz/corpus."""

from __future__ import annotations

import argparse
import hashlib
import logging
import subprocess
import sys
import warnings
from collections.abc import Iterable
from pathlib import Path

from fuzz.table import TABLE, load

KEPT = Path(__file__).parent / "corpus"
"""One folder a target; each input is named by its SHA-256."""
FOUND = Path("results/fuzz")
SECONDS = 10
"""An input that takes longer is a finding."""
MEGABYTES = 1500
"""An input that makes the process larger is a finding."""
BUDGET = 12_000
"""Bytes of a target's kept corpus, beside its longest seed."""


def main() -> None:
    """Read the command line and do it."""
    parser = argparse.ArgumentParser("python -m fuzz", description=__doc__)
    parser.add_argument("target", nargs="?", choices=[*TABLE, "all"], help="left out: list the targets")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--corpus", type=Path, help="what the search has found so far (default: results/fuzz/TARGET)")
    parser.add_argument("--input", type=Path, action="append", help="run only these files, e.g. a finding")
    parser.add_argument("--keep", action="store_true", help="take the best of the corpus into fuzz/corpus")
    asked = parser.parse_args()
    if asked.target is None:
        sys.exit("\n".join(f"{name:12} {entry.reads}" for name, entry in TABLE.items()))
    if asked.target == "all":
        sys.exit(_all(sys.argv[1:]))
    if asked.input:
        for file in asked.input:
            load(asked.target).run(file.read_bytes())
        return
    corpus = asked.corpus or FOUND / asked.target
    corpus.mkdir(parents=True, exist_ok=True)
    if asked.keep:
        _keep(asked.target, corpus)
    else:
        _search(asked.target, corpus, asked.minutes)


def _all(arguments: list[str]) -> int:
    """Every target in a process of its own."""
    done = [subprocess.run([sys.executable, "-m", "fuzz", *_with(arguments, name)], check=False) for name in TABLE]
    return max(process.returncode for process in done)


def _with(arguments: list[str], name: str) -> list[str]:
    return [name if argument == "all" else argument for argument in arguments]


def _search(name: str, corpus: Path, minutes: float) -> None:
    try:
        import atheris
    except ModuleNotFoundError:
        sys.exit("the search needs atheris: pip install -e '.[fuzz]'")
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    with atheris.instrument_imports(include=["cellwatt", "cellwatt_drivers", "cellwatt_plugins", *TABLE[name].foreign]):
        target = load(name)
    seeds = corpus.with_name(f"{corpus.name}.seeds")
    write(seeds, target.seeds())
    findings = corpus.with_name(f"{corpus.name}.findings")
    findings.mkdir(exist_ok=True)
    kept = [str(KEPT / name)] if (KEPT / name).is_dir() else []
    options = [
        f"-max_total_time={round(60 * minutes)}",
        f"-timeout={SECONDS}",
        f"-rss_limit_mb={MEGABYTES}",
        f"-max_len={target.longest}",
        f"-artifact_prefix={findings}/",
        "-print_final_stats=1",
        "-use_value_profile=1",
    ]
    atheris.Setup([sys.argv[0], *options, str(corpus), str(seeds), *kept], target.run, enable_python_coverage=True)
    atheris.Fuzz()


def _keep(name: str, corpus: Path) -> None:
    """Write the smallest inputs that together run all lines and branches that the whole corpus runs."""
    from fuzz.kept import smallest

    target = load(name)
    old = [file.read_bytes() for file in sorted((KEPT / name).glob("*"))] if (KEPT / name).is_dir() else []
    inputs = {*target.seeds(), *old, *(file.read_bytes() for file in corpus.iterdir())}
    chosen = smallest(target.run, inputs, BUDGET + max(map(len, target.seeds())))
    for file in (KEPT / name).glob("*"):
        file.unlink()
    write(KEPT / name, chosen)
    print(f"{name}: {len(chosen)} of {len(inputs)} inputs kept, {sum(map(len, chosen))} bytes")


def write(folder: Path, inputs: Iterable[bytes]) -> None:
    """Inputs as files named by their content."""
    folder.mkdir(parents=True, exist_ok=True)
    for data in inputs:
        (folder / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)


if __name__ == "__main__":
    main()
