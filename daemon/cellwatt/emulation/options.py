"""Options of an emulator: ``KEY=VALUE`` of the command line, converted by type."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

T = TypeVar("T", bound=str)


class Options:
    """Texts by name; every method returns the default if the option is not given.

    All raise ``ValueError`` for a text of the wrong type.
    """

    def __init__(self, given: Mapping[str, str]) -> None:
        self._left = dict(given)
        self._known: list[str] = []

    def text(self, name: str, default: str = "") -> str:
        """Return a text."""
        self._known.append(name)
        return self._left.pop(name, default)

    def choice(self, name: str, default: T, among: Sequence[T]) -> T:
        """Return one of several texts."""
        found = self.text(name, default)
        for known in among:
            if found == known:
                return known
        raise ValueError(f"{name} is one of {', '.join(among)}, not {found!r}")

    def flag(self, name: str, default: bool) -> bool:
        """Return true for ``1`` or ``yes``, false for ``0`` or ``no``."""
        return self.choice(name, "yes" if default else "no", ("yes", "no", "1", "0")) in ("yes", "1")

    def number(self, name: str, default: float) -> float:
        """Return a number."""
        return self.numbers(name, (default,))[0]

    def whole(self, name: str, default: int) -> int:
        """Return a whole number."""
        found = float(self.number(name, default))
        if not found.is_integer():
            raise ValueError(f"{name} is a whole number, not {found:g}")
        return int(found)

    def numbers(self, name: str, default: Sequence[float]) -> tuple[float, ...]:
        """Return the numbers of a list with commas."""
        text = self.text(name)
        try:
            return tuple(float(part) for part in text.split(",")) if text else tuple(default)
        except ValueError:
            raise ValueError(f"{name} is a number, or several with commas, not {text!r}") from None

    def refuse_rest(self) -> None:
        """Raise ``ValueError`` if an option was never read."""
        if self._left:
            known = f"there are: {', '.join(self._known)}" if self._known else "there are none"
            raise ValueError(f"unknown options: {', '.join(self._left)}; {known}")
