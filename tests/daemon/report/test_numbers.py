"""Numbers as printed: rounded to what is known of them."""

from __future__ import annotations

import pytest

from cellwatt.report.numbers import listed, measured, times, unit


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (4.1234, 0.2, "4.1 ± 0.2"),
        (-12.6, 3.0, "−13 ± 3"),
        (1234567.0, 8000.0, "(1.235 ± 0.008)·10⁶"),
        (2.352e-5, 3e-7, "(2.35 ± 0.03)·10⁻⁵"),
        (0.0, 0.02, "0.00 ± 0.02"),
        (9.97, 0.0996, "9.97 ± 0.10"),
        (3.14159, float("nan"), "3.14"),
        (0.0, 0.0, "0"),
    ],
)
def test_numbers_are_rounded_to_their_uncertainty(value: float, std: float, text: str) -> None:
    assert measured(value, std) == text


def test_units_lists_and_ratios_as_people_write_them() -> None:
    assert unit("kg*m^2") == "kg·m²"
    assert unit("N*m*s/rad") == "N·m·s/rad"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert listed([]) == ""
    assert (times(3.14), times(9.97)) == ("3.1×", "10×")
