"""``import cellwatt``: light, and with the names that other packages register."""

import subprocess
import sys
from pathlib import Path

import pytest

import cellwatt as cw

HEAVY = ("pyarrow", "zenoh", "onnxruntime", "pandas", "scipy", "mcap", "pinocchio", "cellwatt_plugins")


def run(code: str, folder: Path) -> str:
    script = f"import sys; sys.path.insert(0, {str(folder)!r})\nimport cellwatt as cw\n{code}"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_it_stays_light(tmp_path):
    assert run(f"print([name for name in {HEAVY} if name in sys.modules])", tmp_path) == "[]"


def test_every_name_of_the_core_is_there():
    for name in cw.__all__:
        assert getattr(cw, name).__doc__, name
    with pytest.raises(AttributeError, match="module 'cellwatt' has no attribute 'nonsense'"):
        _ = cw.nonsense


@pytest.fixture
def package(tmp_path):
    (tmp_path / "acme.py").write_text("def wave(): return 'waved'\n")
    (tmp_path / "sunk.py").write_text("import no_such_package\n")
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cellwatt.api]\nwave = acme:wave\ndive = sunk:dive [ocean]\n")
    return tmp_path


def test_a_package_adds_a_name(package):
    assert run("print('wave' in dir(cw), 'acme' in sys.modules, cw.wave())", package) == "True False waved"
    assert run("from cellwatt import wave; print(wave())", package) == "waved"


def test_a_missing_package_is_told_with_the_extra_that_has_it(package):
    code = "try: cw.dive\nexcept cw.ConfigError as error: print(error)"
    assert run(code, package) == "cellwatt.dive needs the package no_such_package: pip install 'acme[ocean]'"
