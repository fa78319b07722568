"""Pages of the documentation, and the code blocks in them.

A comment of HTML right before a block tells who runs it, where that is not tests/docs: ``<!-- run by tests/… -->``,
or why nobody does: ``<!-- not run: … -->``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel

from cellwatt.config.reference import reference

ROOT = Path(__file__).resolve().parents[2]
PAGES = (*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")), *sorted(ROOT.glob("docs/**/*.md")))
BLOCK = re.compile(
    r"(?:^<!-- (?P<note>[^\n]*) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: its page from the root of the repository, line of its first fence, language, text and note."""

    page: str
    line: int
    language: str
    text: str
    note: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def run_here(self) -> bool:
        """True if no note says who runs it, or why nobody does."""
        return not self.note

    def commands(self) -> Iterator[str]:
        """Lines of a shell block as the shell sees them: continued ones joined."""
        yield from (line for line in self.text.replace("\\\n", " ").splitlines() if line.strip())


def blocks(page: Path | str, language: str = "") -> list[Block]:
    """Return the blocks of a page (of docs/, where given by name) in order; of one language if asked."""
    path = ROOT / "docs" / page
    text = path.read_text(encoding="utf-8")
    found = []
    for m in BLOCK.finditer(text):
        line = text.count("\n", 0, m.start("language")) + 1
        found.append(Block(str(path.relative_to(ROOT)), line, m["language"], m["text"], m["note"] or ""))
    return [block for block in found if not language or block.language == language]


EVERY_BLOCK = [block for page in PAGES for block in blocks(page)]


def settings_table(model: type[BaseModel]) -> str:
    """The reference of a settings class as a Markdown table, as in ``docs/settings.md``."""
    lines = ["| key | type | default | meaning |", "|---|---|---|---|"]
    for field in reference(model):
        default = "required" if field.required else f"`{field.default}`" if field.default else ""
        cells = (f"`{field.key}`", field.type, default, field.description)
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(lines)
