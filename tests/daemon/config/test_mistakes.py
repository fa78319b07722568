"""A table of what people get wrong, and the one line that each gets."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cellwatt.config import load
from cellwatt.config.places import position
from cellwatt.errors import ConfigError
from tests.daemon.config.conftest import VALID

SMALL = "site: a\ncell: b\nsources:\n  arm:\n    driver: arm\n    host: h\n"
"""Six lines; what a row adds starts at line 7."""


def arm(line: str) -> str:
    return f"{SMALL}    {line}\n"


def stages(text: str) -> str:
    return f"{SMALL}stages:\n{text}"


MISTAKES = {
    # the file
    "empty": ("", "1:1", "the file is empty"),
    "newer": (f"version: 7\nshape: new\n{SMALL}", "1:10", "settings of version 7, this cellwatt reads version 1"),
    "version in words": (f"{SMALL}version: one\n", "7:10", "found 'one', expected a whole number"),
    "version 0": (f"{SMALL}version: 0\n", "7:10", "found 0, expected at least 1"),
    "a list": ("- site: a\n", "1:1", "found a list, expected settings (key: value)"),
    "not UTF-8": (b"site: caf\xe9\n", "1:10", "not UTF-8 text (byte 0xe9)"),
    "control character": ("site: a\ncell: b\x07\n", "2:8", "character U+0007 is not allowed"),
    "tab": ("site: a\ncell: b\nsources:\n\tarm: {driver: arm}\n", "4:1", "indent with spaces"),
    "colon in a value": ("site: plant: 1\n", "1:12", "a value that holds ': ' needs quotes"),
    "bad indentation": ("site: a\n cell: b\n", "2:6", "check the indentation"),
    "two cells": ("site: a\n---\nsite: b\n", "2:1", "one cell a file"),
    "unknown alias": (arm("note: *nowhere"), "7:11", "needs its anchor"),
    "unknown tag": (arm("note: !secret x"), "7:11", "the tag !secret means nothing here"),
    "anchor within itself": (arm("zones: &a {x: *a}"), "7:19", "an anchor that contains itself"),
    "character 0": (arm(r'host2: "a\0b"'), "7:12", "the character U+0000"),
    "backslash": (arm(r'note: "C:\path"'), "7:15", "write a backslash in 'single quotes'"),
    # the top level
    "no sources": ("site: a\ncell: b\n", "1:1", "the key 'sources' is missing"),
    "empty sources": ("site: a\ncell: b\nsources: {}\n", "3:1", "found no source"),
    "no site": (SMALL.removeprefix("site: a\n"), "1:1", "the key 'site' is missing (Name of the plant"),
    "misspelt section": (SMALL.replace("sources", "source"), "3:1", "unknown key 'source'; did you mean 'sources'?"),
    "unknown section": (
        f"{SMALL}alarms: {{}}\n",
        "7:1",
        "unknown key 'alarms' (keys here: site, cell, version, robot,",
    ),
    "blank in a name": (
        SMALL.replace("cell: b", "cell: weld 3"),
        "2:7",
        "_.-]*$ (Name of the cell within the site, second element of every Zenoh key: letters, digits, ., _ and -)",
    ),
    "space of a web page": (arm("note:\u00a0x"), "7:10", "character U+00A0 is no space to YAML"),
    "a star": (arm("note: *"), "7:12", "a value with * or & needs quotes, like '*'"),
    "bool as a key": (f"{SMALL}true: x\n", "7:1", 'expected a name; write it in quotes: "true"'),
    "list as a key": (f"{SMALL}? [a]\n: x\n", "7:3", "found a list or mapping as a key"),
    "same key twice": (f"site: z\n{SMALL}", "2:1", "'site' is given twice, first at line 1 column 1"),
    "same source twice": (f"{SMALL}  arm: {{driver: arm, host: i}}\n", "7:3", "'arm' is given twice, first at line 4"),
    # sources
    "no driver": (
        "site: a\ncell: b\nsources:\n  arm: {host: h}\n",
        "4:3",
        "the key 'driver' is missing (one of: absent",
    ),
    "misspelt driver": ("site: a\ncell: b\nsources:\n  x: {drivr: arm}\n", "4:7", "'drivr'; did you mean 'driver'?"),
    "unknown driver": (
        SMALL.replace("driver: arm", "driver: arn"),
        "5:13",
        "no driver named 'arn'; did you mean 'arm'?",
    ),
    "package not installed": (SMALL.replace("driver: arm", "driver: absent"), "5:13", "no_such_package_anywhere"),
    "source name": (SMALL.replace("  arm:", "  Arm 1:"), "4:3", "found 'Arm 1' as a name, expected small letters"),
    "same network device": (f"{SMALL}  arm2: {{driver: arm, host: H}}\n", "7:3", "same device as 'arm' (h port 30004)"),
    "same serial port": (
        f"{SMALL}  x: {{driver: meter, port: /dev/ttyS9}}\n  y: {{driver: meter, port: /dev/../dev/ttyS9}}\n",
        "8:3",
        "reads the same device as 'x' (/dev/ttyS9)",
    ),
    # values
    "missing setting": (
        SMALL.replace("    host: h\n", ""),
        "4:3",
        "the key 'host' is missing (Address of the controller)",
    ),
    "misspelt setting": (SMALL.replace("host: h", "hots: h"), "6:5", "unknown key 'hots'; did you mean 'host'?"),
    "text for a number": (arm("port: rtde"), "7:11", "found 'rtde', expected a whole number"),
    "port too large": (arm("port: 70000"), "7:11", "found 70000, expected at most 65535"),
    "digits without end": (arm(f"port: {'9' * 5000}"), "7:11", "cannot be read as !!int"),
    "rate without a unit": (arm("rate: 500"), "7:11", "found 500: expected a number with its unit, like '500 Hz'"),
    "wrong unit": (arm("rate: 2 ms"), "7:11", "found '2 ms': unknown unit 'ms'; expected one of Hz"),
    "negative rate": (arm("rate: -5 Hz"), "7:11", "found '-5 Hz': must be above zero"),
    "not a number": (arm("payload: .nan"), "7:14", "found .nan, expected a finite number"),
    "unknown choice": (arm("client: natve"), "7:13", "expected 'native' or 'library'; did you mean 'native'?"),
    "not a bool": (arm("verify: maybe"), "7:13", "found 'maybe', expected true or false"),
    "list for a text": (arm("note: [a]"), "7:11", "found a list, expected text"),
    "the driver's own rule": (arm("joints: [1, 1]"), "7:13", "sources.arm.joints: each joint may be named once only"),
    "rule about two settings": (arm("user: me"), "4:3", "user and password go together"),
    "below a name": (arm("zones: {left: {power: 1 V}}"), "7:27", "unknown unit 'V'"),
    "either of two": (arm("box: red"), "7:10", "found 'red', expected a whole number or true or false"),
    "number as a key": (arm("5: x"), "7:5", "the key 5 must be text"),
    # the environment
    "variable without braces": (arm("note: $PORT"), "7:11", "'$PORT' is not replaced; write '${PORT}'"),
    "variable not set": (arm("note: ${NOWHERE}"), "7:11", "environment variable NOWHERE is not set"),
    "variable not closed": (arm("note: ${NOWHERE"), "7:11", "'${' is never closed"),
    "variable in braces": (arm("zones: {left: ${NOWHERE}}"), "7:20", 'within { }, ${NAME} needs quotes: "${NAME}"'),
    "brace left open": (arm("zones: {left: a #b}"), "8:1", "the bracket of line 7 column 12 is still open"),
    "value from a variable": (arm("port: ${PORT}"), "7:11", "found the value of ${PORT}, expected a whole number"),
    # frames, stages, record, outlets
    "an age below zero": (f"{SMALL}record: {{age: -30 d}}\n", "7:15", "found '-30 d', expected at least 0"),
    "too many frames": (f"{SMALL}frames: {{rate: 2 kHz}}\n", "7:16", "found '2 kHz', expected at most 1 kHz"),
    "latency too short": (
        f"{SMALL}frames: {{latency: 5 ms}}\n",
        "7:19",
        "found '5 ms': the latency must be at least one",
    ),
    "unknown stage": (stages("  cutt: {}\n"), "8:3", "no stage named 'cutt'; did you mean 'cut'?"),
    "own name without a kind": (stages("  power: {}\n"), "8:3", "is 'power' your own name? then add 'stage: KIND'"),
    "stage needs another": (stages("  watch: {}\n"), "8:3", "needs a stage of the kind 'cut'"),
    "file not there": (stages("  net: {file: no.onnx}\n"), "8:15", "found 'no.onnx', expected a file that exists"),
    "a robot that is not there": (
        f"{SMALL}robot: robots/ur99\n",
        "7:8",
        "found 'robots/ur99', expected a robot.yaml or the folder that holds one: ",
    ),
}


def mistakes_in(file: Path, **environ: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(file, environ)
    return [str(p) for p in caught.value.problems]


def test_each_mistake_is_one_line_at_its_place(cell_file):
    for name, (text, place, message) in MISTAKES.items():
        cell_file.write_bytes(text if isinstance(text, bytes) else text.encode())
        lines = mistakes_in(cell_file, PORT="hunter2")
        assert len(lines) == 1, (name, lines)
        assert lines[0].startswith(f"{cell_file}:{place}: "), (name, lines)
        assert message in lines[0], name
        assert "\n" not in lines[0] and "hunter2" not in lines[0] and len(lines[0]) < 350, name


def test_a_name_that_no_file_can_have(tmp_path):
    (line,) = mistakes_in(tmp_path / "a\0b")
    assert line.startswith(f"{tmp_path}/a\0b: cannot be read")


@pytest.mark.parametrize("form", ["[{0}]", "{{<<: [{0}]}}"])
def test_aliases_that_stand_for_billions(cell_file, form):
    lines = ["a0: &a0 {x: 1, y: 2}"]
    lines += [f"a{i}: &a{i} " + form.format(", ".join([f"*a{i - 1}"] * 10)) for i in range(1, 12)]
    cell_file.write_text("\n".join(lines))
    assert "more than 20,000 values" in mistakes_in(cell_file)[0]


def test_a_secret_in_a_validators_own_words_is_hidden(cell_file):
    cell_file.write_text(arm("rate: 5 ${UNIT}"))
    (line,) = mistakes_in(cell_file, UNIT="topsecret")
    assert "topsecret" not in line
    assert "${UNIT}" in line


def test_mistakes_in_a_merged_value_point_to_where_it_is_written(cell_file):
    cell_file.write_text(
        "site: a\ncell: b\nsources:\n  one: &x {driver: arm, host: h, port: x}\n  two: {<<: *x, host: i}\n"
    )
    lines = mistakes_in(cell_file)
    assert [re.sub(r".*?:(\d+:\d+): ([^:]*):.*", r"\1 \2", line) for line in lines] == [
        "4:40 sources.one.port",
        "4:40 sources.two.port",
    ]


def test_places_point_into_the_file(cell_file):
    cell_file.write_text(VALID.replace("500 Hz", "500 Hz, nope: 1").replace("/dev/ttyUSB0", "[]"))
    with pytest.raises(ConfigError) as caught:
        load(cell_file)
    text = cell_file.read_text().splitlines()
    found = [position(p) for p in caught.value.problems]
    assert [text[p.line - 1][p.column - 1 :][:4] for p in found] == ["nope", "[]"]
