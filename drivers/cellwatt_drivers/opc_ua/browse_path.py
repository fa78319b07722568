"""Browse paths: their notation, and the children that match a step."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

_ELEMENT = re.compile(r"((?:[^/&]|&.)+)(?:/|$)")
_ANY = re.compile(r"\*([1-9][0-9]*)?")
_PREFIXED = re.compile(r"([a-z][a-z0-9_]*|[0-9]+):(.+)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Step:
    """One step down: a child's name, with prefix or number of its namespace; or ``any`` child, the ``nth``, 0: each."""

    name: str
    prefix: str = ""
    any: bool = False
    nth: int = 0

    def __str__(self) -> str:
        if self.any:
            return f"*{self.nth or ''}"
        return f"{self.prefix}:{self.name}" if self.prefix else self.name


@dataclass(frozen=True, slots=True)
class Child:
    """A child of a node, with the text of its node id."""

    name: str
    namespace: int
    node: str
    is_object: bool


def parsed(path: str) -> tuple[Step, ...]:
    """Split a path below Objects into steps; ``&`` makes the next character literal.

    Raises ``ValueError`` for a path with an empty step.
    """
    rest = path.removeprefix("/").removeprefix("0:Objects/").removeprefix("Objects/")
    steps, offset = [], 0
    while offset < len(rest):
        found = _ELEMENT.match(rest, offset)
        if found is None or rest.endswith("/"):
            raise ValueError(f"the browse path {path!r} has an empty step")
        steps.append(_step(found[1]))
        offset = found.end()
    if not steps:
        raise ValueError("the browse path is empty")
    return tuple(steps)


def _step(text: str) -> Step:
    if found := _ANY.fullmatch(text):
        return Step("", any=True, nth=int(found[1] or 0))
    prefixed = _PREFIXED.fullmatch(text)
    prefix, name = (prefixed[1], prefixed[2]) if prefixed else ("", text)
    return Step(re.sub(r"&(.)", r"\1", name), prefix)


def chosen(step: Step, children: Sequence[Child], namespace: int | None) -> list[Child]:
    """Return the children that match a step, in the order in which to try them.

    ``namespace`` is the number of the step's namespace; ``None`` for any.
    """
    if not step.any:
        return [c for c in children if c.name == step.name and namespace in (None, c.namespace)]
    objects = sorted((c for c in children if c.is_object), key=lambda c: _natural(c.name))
    return objects[step.nth - 1 : step.nth] if step.nth else objects


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts Axis_2 before Axis_10."""
    return [(int(part), "") if part.isdecimal() else (0, part.casefold()) for part in re.split(r"(\d+)", name)]
