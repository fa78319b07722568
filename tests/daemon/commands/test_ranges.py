from __future__ import annotations

from cellwatt.commands.ranges import summary
from cellwatt.runtime.examine import ChannelCheck


def check(name: str, unit: str, low: float | None, high: float | None) -> ChannelCheck:
    return ChannelCheck(name, unit, 1.0 if low is not None else 0.0, low, high)


def test_85_channels_of_an_arm_are_a_few_lines() -> None:
    joints = [
        check(f"joint_{i}.{quantity}", unit, -float(i), float(i))
        for quantity, unit in (("position", "rad"), ("velocity", "rad/s"), ("current", "A"))
        for i in range(1, 7)
    ]
    registers = [check(f"output_int_register_{i}", "1", 0.0, 0.0) for i in range(64)]
    others = [check("robot.mode", "1", 7.0, 7.0), check("supply.voltage", "V", 48.0, 48.0)]
    others.append(check("bus.power", "W", 80.0, 420.12345))
    assert summary([*joints, *registers, *others]) == [
        "joint_1…6.position: -6 … 6 rad",
        "joint_1…6.velocity: -6 … 6 rad/s",
        "joint_1…6.current: -6 … 6 A",
        "bus.power: 80 … 420.1 W",
        "constant: output_int_register_0…63 0, robot.mode 7, supply.voltage 48 V",
    ]


def test_what_is_no_number_is_told() -> None:
    assert summary(
        [
            check("joint_1.temperature", "degC", 20.0, 25.0),
            check("joint_2.temperature", "degC", None, None),
            check("joint_4.temperature", "degC", 22.0, 22.0),
            check("input_7", "1", None, None),
        ]
    ) == ["joint_1,2,4.temperature: 20 … 25 degC, 1 of 3 without a value", "input_7: no value"]
