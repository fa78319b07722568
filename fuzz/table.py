"""The targets by name."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass

from fuzz.target import Target


@dataclass(frozen=True)
class Entry:
    """What a target ``reads``, and the packages of others in Python whose branches guide the search as well."""

    reads: str
    foreign: tuple[str, ...] = ()


DRIVERS: Mapping[str, Entry] = {
    "yaskawa": Entry("High-Speed Ethernet Server: frames and what they carry"),
    "ur": Entry("RTDE: a stream of frames up to samples and events"),
    "egm": Entry("ABB EGM datagrams up to samples"),
    "rws": Entry("pages of ABB's Robot Web Services"),
    "franka": Entry("states of the library's process; FCI messages that the emulator reads"),
    "kinova": Entry("blocks of input registers"),
    "power_board": Entry("serial bytes of the receiver in three modes, and the board's payload"),
    "scpi": Entry("an analyzer's lines"),
    "modbus": Entry("a meter's registers, its counters"),
    "meter_map": Entry("a Modbus meter's map, YAML", ("yaml",)),
    "can": Entry("CAN frames up to samples, slcan lines, error frames", ("can",)),
    "sensor_map": Entry("a CAN sensor's map, YAML, and its DBC file", ("yaml", "cantools", "textparser")),
    "opc_ua": Entry("what an OPC UA server tells the driver; what a client hands to the method that acknowledges"),
}
"""Those of ``fuzz.drivers``."""
TABLE: Mapping[str, Entry] = {
    **DRIVERS,
    "recording": Entry("an MCAP file: summary, chunks, recovery", ("mcap",)),
    "rows": Entry("the records of a chunk: samples, frames, JSON"),
    "ring": Entry("the ring's items"),
    "settings": Entry("a cell's settings, YAML", ("yaml",)),
    "robot": Entry("robot.yaml"),
    "urdf": Entry("a URDF"),
    "reference": Entry("references, power equations, models: YAML"),
    "model": Entry("what a model file says about itself, JSON"),
    "csv": Entry("CSV tables that people bring"),
    "sheet": Entry("CSV tables drawn from what spreadsheets, loggers and locales write"),
    "foreign": Entry("MCAP files of other writers, as logs of joints"),
    "question": Entry("a consumer's Zenoh question: selector and answer"),
    "message": Entry("a cell's Zenoh message: key, mark, JSON"),
    "arrow": Entry("a cell's Zenoh message: mark, Arrow stream"),
    "subscriber": Entry("a sequence of messages and answers at a subscriber"),
    "page": Entry("requests to the page: host, cookie, token against forgery, query, body"),
    "wire": Entry("messages between the daemon and the processes that serve for outlets, both ways"),
    "mqtt": Entry("what a broker hands over: Sparkplug's commands and host state, kept alarms"),
    "influx": Entry("InfluxDB's answers: status, Retry-After, body"),
}


def load(name: str) -> Target:
    """A target by its name; imports what it reads with."""
    room = "fuzz.drivers" if name in DRIVERS else "fuzz"
    target = importlib.import_module(f"{room}.{name}").TARGET
    assert isinstance(target, Target)
    return target
