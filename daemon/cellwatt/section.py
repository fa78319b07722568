"""The bases of all settings classes."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, PrivateAttr

_FILES: Final = ("ca", "root_ca", "certificate", "key")
"""Settings that are files of certificates and keys, in the sections that have them."""


class Section(BaseModel):
    """A section of settings: unknown keys are refused, and no error quotes the value given, which may be a secret."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, hide_input_in_errors=True)


class Certified(Section):
    """A section with certificates: a renewed file counts as a change of the settings, so that a reload applies it."""

    _written: dict[Path, int] = PrivateAttr(default_factory=dict)
    """Modification times of the files, ns."""

    def model_post_init(self, _: object) -> None:
        """Read the modification times; files that cannot be read here are reported when they are needed."""
        for path in (getattr(self, name, None) for name in _FILES):
            if isinstance(path, Path):
                with contextlib.suppress(OSError):
                    self._written[path] = path.stat().st_mtime_ns
