"""A value that all items share, on its way to the workers.

It is no dependency of the items: dask would give them to those workers alone that have it first.
"""

from __future__ import annotations

from typing import Any, Final

from cellwatt.errors import CellwattError
from cellwatt.scheduler.parcel import pack
from cellwatt.scheduler.task import Shared, hold

_TRIES: Final = 10
"""Workers that may die of the value itself."""


class Handed:
    """A value under a ``name``, sent to the scheduler once, and from worker to worker as they ask for it."""

    def __init__(self, client: Any, name: str, value: Any) -> None:
        self.name = name
        self._client, self._value = client, value
        self._copies: dict[str, Any] = {}
        self._given = self._failed = 0
        self._source = self._sent()

    def give(self, worker: str) -> None:
        """Let a worker hold the value, if it is not about to. Raises ``CellwattError`` where that never succeeds."""
        before = self._copies.get(worker)
        if before is not None and not before.done():
            return
        failed = next((f for f in (self._source, before) if f is not None and f.status == "error"), None)
        if failed is not None:
            self._failed += 1
            if self._failed > _TRIES:
                raise CellwattError(f"what all items share does not come to the workers: {failed.exception()}")
            self._source = self._sent()
        self._given += 1
        # Elsewhere, if that one is gone by now: else it would be waited for.
        self._copies[worker] = self._client.submit(
            hold,
            self._source,
            key=f"{self.name}-held-{self._given}",
            workers=[worker],
            allow_other_workers=True,
            pure=False,
        )

    def coming(self) -> list[Any]:
        """Futures of the workers that are being given the value."""
        return [future for future in self._copies.values() if not future.done()]

    def _sent(self) -> Any:
        key = f"{self.name}-shared-{self._failed}"
        return self._client.submit(Shared, self.name, pack(self._value), key=key, pure=False)
