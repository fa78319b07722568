"""Whatever is typed into a settings file, the answer is a config or a ``ConfigError``."""

from __future__ import annotations

from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwatt.config import CellConfig, load, public_config
from cellwatt.config.places import position
from cellwatt.errors import ConfigError
from cellwatt.runtime.assemble import prepare
from tests.daemon.config.conftest import VALID

PIECES = st.one_of(
    st.text(max_size=3),
    st.sampled_from(
        ["&a ", "*a", "<<: *a", "${", "${X}", "!!int ", "'", '"', "\t", "\n", ": ", "- ", "{", "}", "[", "]"]
    ),
    st.sampled_from(["null", "true", "1e999", "0x", "-", "? ", "| ", "%", "---\n", "...\n", "\ufeff", "\0", "\x85"]),
)


@st.composite
def mutated(draw: st.DrawFn) -> str:
    text = VALID
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = start + draw(st.integers(0, 12))
        text = text[:start] + draw(PIECES) + text[end:]
    return text


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(text=mutated())
def test_any_text_gives_a_config_or_a_config_error(cell_file: Path, text: str) -> None:
    content = text.encode("utf-8", "surrogatepass")
    cell_file.write_bytes(content)
    lines = content.decode("utf-8", "replace").count("\n") + 1 + sum(text.count(c) for c in "\r\x85\u2028\u2029")
    try:
        config = load(cell_file, {"X": "y"})
        assert isinstance(config, CellConfig)
        public_config(config)
        prepare(config)
    except ConfigError as error:
        assert error.problems
        for problem in error.problems:
            assert "\n" not in str(problem)
            file, line, column = position(problem)
            assert file == str(cell_file)
            assert 1 <= (line or 1) <= lines + 1
            assert (column or 1) >= 1
