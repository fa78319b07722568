import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.recordings import read_reading


def test_names_that_are_no_text(tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes(b"t,\xefq\n0,1\n")
    with pytest.raises(RecordingError, match="cannot be read as a table"):
        read_reading(path)


def test_two_columns_of_one_name(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,power,t\n0,1,2\n")
    with pytest.raises(RecordingError, match="two columns are called 't'"):
        read_reading(path)
