"""Self-signed certificates of devices and clients."""

from __future__ import annotations

import subprocess
from pathlib import Path


def self_signed(folder: Path, name: str, **extensions: str) -> tuple[Path, Path]:
    """Files of a certificate with these X.509 extensions, and of its key."""
    files = folder / f"{name}.pem", folder / f"{name}-key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}"]
    command += [word for extension in extensions.items() for word in ("-addext", "=".join(extension))]
    subprocess.run([*command, "-out", files[0], "-keyout", files[1]], check=True, capture_output=True)
    return files
