"""A zip file with a table of its contents and of the files that could not be collected."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from cellwatt.errors import CellwattError, why
from cellwatt.host import without

_README: Final = """\
This is a bundle for a bug report about cellwatt, written by `cellwatt diagnose`.

Passwords and values from the environment are left out: *** or ${NAME} replaces them. The bundle contains no environment
variables. It does contain names of the plant, its cells, devices and addresses, and paths and users of this PC: read
the files before you give the bundle to others.

"""


@dataclass(slots=True)
class Bundle:
    """Files for the zip, by name: description and text. ``secrets`` are replaced in every text."""

    secrets: dict[str, str] = field(default_factory=dict)
    texts: dict[str, tuple[str, str]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, what: str, make: Callable[[], str | Mapping[str, Any] | list[Any]]) -> None:
        """Add the result of ``make``, as JSON unless it is text; if ``make`` fails, store the reason in ``missing``."""
        try:
            made = make()
        except Exception as error:  # the bundle must be written whatever is broken
            known = why(error) if isinstance(error, OSError) else str(error)
            reason = known if isinstance(error, CellwattError | OSError) else f"{type(error).__name__}: {error}"
            self.missing[name] = f"{what}: {reason}"
        else:
            text = made if isinstance(made, str) else json.dumps(made, indent=2, ensure_ascii=False, default=str)
            self.texts[name] = what, text.rstrip("\n") + "\n"

    def listing(self) -> str:
        """Lines with the size of each file, and with the reason for each missing file."""
        sizes = {name: (what, len(self._blanked(text).encode())) for name, (what, text) in self.texts.items()}
        wide = max(map(len, sizes), default=0)
        lines = [f"  {name:<{wide}}  {size / 1e3:9.1f} kB  {what}" for name, (what, size) in sizes.items()]
        absent = [f"  {self._blanked(reason)}" for reason in self.missing.values()]
        return "\n".join(["Contents:", *lines, *(["Not collected:", *absent] if absent else [])]) + "\n"

    def write(self, path: Path) -> None:
        """Write the zip, readable by its owner only. Raises ``CellwattError`` if it cannot be written."""
        try:
            with (
                os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file,
                zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
            ):
                os.fchmod(file.fileno(), 0o600)  # an existing file may be readable by all
                archive.writestr("README.txt", _README + self.listing())
                for name, (_, text) in self.texts.items():
                    archive.writestr(name, self._blanked(text))
        except OSError as error:
            raise CellwattError(f"{path} cannot be written: {why(error)}") from error

    def _blanked(self, text: str) -> str:
        # A value with quotes or line ends is escaped in JSON.
        escaped = {json.dumps(value, ensure_ascii=False)[1:-1]: shown for value, shown in self.secrets.items()}
        return without(text, escaped | self.secrets)
