"""The commitment on the seed: a digest in the repository before the run, the seed itself after it."""

from __future__ import annotations

import hashlib
import json
import secrets
from pathlib import Path

COMMITMENT = Path(__file__).with_name("commitment.json")
REVEALED = Path(__file__).with_name("seed.json")
"""Where the seed file is put after the run that it was committed for; those of earlier runs are `-run3` and so on."""


def digest(seed: str, salt: str) -> str:
    """SHA-256 over seed and salt, in hex."""
    return hashlib.sha256(f"{seed}:{salt}".encode()).hexdigest()


def commit(seed_file: Path, commitment: Path = COMMITMENT) -> str:
    """Draw a seed into a file that stays secret until the run, and write its digest; returns the digest.

    Raises FileExistsError where the seed file is there already.
    """
    seed, salt = secrets.token_hex(16), secrets.token_hex(16)
    with seed_file.open("x") as out:
        json.dump({"seed": seed, "salt": salt}, out)
    seed_file.chmod(0o600)
    commitment.write_text(json.dumps({"algorithm": "sha256(seed:salt)", "sha256": digest(seed, salt)}, indent=1) + "\n")
    return digest(seed, salt)


def reveal(seed_file: Path, commitment: Path = COMMITMENT) -> tuple[str, str, bool]:
    """Seed and salt of a file, and whether they are among those committed, for this run or an earlier one."""
    content = json.loads(seed_file.read_text())
    seed, salt = content["seed"], content["salt"]
    promises = commitment.parent.glob(f"{commitment.stem}*.json")
    return seed, salt, digest(seed, salt) in {json.loads(p.read_text())["sha256"] for p in promises}
