"""Shared code of device emulators: signals to serve, faults to inject, a process for each emulator."""

from cellwatt.emulation.arm import ArmSignals
from cellwatt.emulation.datagrams import Datagrams
from cellwatt.emulation.emulator import Emulator
from cellwatt.emulation.faults import FAULT_KINDS, Fault, Injector
from cellwatt.emulation.options import Options
from cellwatt.emulation.port import Port, PortEmulator, TcpPort
from cellwatt.emulation.process import EmulatorProcess
from cellwatt.emulation.signals import RecordedSignals, Signals, load_signals

__all__ = [
    "FAULT_KINDS",
    "ArmSignals",
    "Datagrams",
    "Emulator",
    "EmulatorProcess",
    "Fault",
    "Injector",
    "Options",
    "Port",
    "PortEmulator",
    "RecordedSignals",
    "Signals",
    "TcpPort",
    "load_signals",
]
