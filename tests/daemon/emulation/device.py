"""The simplest emulator: something to have faults and counts."""

from __future__ import annotations

from cellwatt.emulation import FAULT_KINDS, Emulator


class Device(Emulator):
    title = "Device"
    faults = FAULT_KINDS

    def __init__(self, address: str = "127.0.0.1:0") -> None:
        super().__init__(None, address, seed=4)

    def set_up(self, options):
        pass

    async def serve(self, ready):
        raise NotImplementedError
