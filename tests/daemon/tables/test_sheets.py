"""Tables as spreadsheets, loggers and locales write them: read as they were meant, or refused by the cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fuzz.sheet import run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwatt.errors import RecordingError
from cellwatt.tables import read_table

NO_TABLE = "cannot be read as a table"


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.binary(min_size=40, max_size=160))
def test_what_is_written_is_read(data: bytes) -> None:
    run(data)


def read(folder: Path, text: str | bytes):
    path = folder / "a.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_table(path)


@pytest.mark.parametrize(
    ("text", "time", "q"),
    [
        ("t;q_1\n0;0\n0,1;0,983\n", [0, 0.1], [0, 0.983]),  # the first row at rest
        ("remark;t;q_1\nstart, cold;0;0.5\n;1;1.5\n", [0, 1], [0.5, 1.5]),
        ('t,q_1\n"0","0"\n"0,1","2,5"\n', [0, 0.1], [0, 2.5]),
        ("t;q_1;;\n0;1;;\n1;2;;\n;;;\n;;;\n", [0, 1], [1, 2]),
        (",t,q_1\n0,0.5,1\n1,1.5,2\n", [0.5, 1.5], [1, 2]),
        ("t,remark,remark,q_1\n0,a,b,1\n1,,,2\n", [0, 1], [1, 2]),
        ("# made by x\n# t, q_1\n0.0 1\n0.1 2\n", [0, 0.1], [1, 2]),
        ("# run of Monday\nt,q_1,0.5\n0,1,5\n1,2,5\n", [0, 1], [1, 2]),  # a column with a number as its name
        ('# "t" "q_1" "q_2"\n"86398,5" "1,0000" "0"\n"86399" "0" "0,0000"', [86398.5, 86399], [1, 0]),
        ("sep=;\r\nt;q_1\r\n0;1\r\n1;2\r\n", [0, 1], [1, 2]),
        ("Run of Monday\n\nt;q_1\n0;1\n1;2\n", [0, 1], [1, 2]),
        ("t;q_1\ns;rad\n0;1\n1;2\n", [0, 1], [1, 2]),
        ("t,q_1,tau_1 [a;b]\n0,1,3\n1,2,3\n", [0, 1], [1, 2]),
        ("t;q_1\n0;\u22120,5\n1;+3\n", [0, 1], [-0.5, 3]),
        ("t;q_1\n0;1.234,5\n1;2.000\n", [0, 1], [1234.5, 2000]),
        ('t,q_1\n0,"1,234.5"\n1,"2,000"\n', [0, 1], [1234.5, 2000]),
        ('t;remark;q_1\n0;"two\nlines";1\n1;3" pipe;2\n', [0, 1], [1, 2]),
        ("t;q_1\n0;1\n1;2\n\0\0\0\0", [0, 1], [1, 2]),
        ("t;q_1\n0;1\n1;2\n".encode("utf-16"), [0, 1], [1, 2]),
        ("t;q_1;Kraft [µN]\n0;1;3\n1;2;3\n".encode("cp1252"), [0, 1], [1, 2]),
        ("Datum;Uhrzeit;q_1\n01.03.2026;23:59:59,5;1\n02.03.2026;00:00:00,5;2\n", [1772409599.5, 1772409600.5], [1, 2]),
        ("Date,Time,q_1\n3/13/2026,11:59:59 PM,1\n3/14/2026,12:00:00 AM,2\n", [1773446399, 1773446400], [1, 2]),
        (",q_1\n2026-03-01 00:00:00,1\n2026-03-01 00:00:00.020,2\n", [1772323200, 1772323200.02], [1, 2]),
        ("time,q_1\n23:59:59.5,1\n00:00:00.5,2\n", [86399.5, 86400.5], [1, 2]),
        ("t,q_1\n172800000000000,1\n172800001000000,2\n", [172800000000000, 172800001000000], [1, 2]),  # since boot
        ("timestamp,q_1\n1772323200000,1\n1772323200020,2\n", [1772323200, 1772323200.02], [1, 2]),
        ("%time,q_1\n1772323200000000000,1\n1772323200020000000,2\n", [1772323200, 1772323200.02], [1, 2]),
        ("sec,nanosec,q_1\n7,500000000,1\n8,20000000,2\n", [7.5, 8.02], [1, 2]),
        ("stamp_secs,stamp_nsecs,q_1\n7,500000000,1\n8,20000000,2\n", [7.5, 8.02], [1, 2]),
        ("/js/header/stamp/sec,/js/header/stamp/nanosec,q_1\n7,5,1\n8,2,2\n", [7.000000005, 8.000000002], [1, 2]),
        ("Time,Time(ms),Etime,Etime(ms),q_1\n0:00:01,500,0:00:00,0,1\n0:00:02,7,0:00:00,507,2\n", [1.5, 2.007], [1, 2]),
        ("Model,WT\nRate,50ms\n\nNo.,Time,Millisecond,q_1\n1,0:00:01,5,1\n2,0:00:01,55,2\n", [1.005, 1.055], [1, 2]),
        ("Time,q_1\n46082.0,1\n46082.00001157407,2\n", [1772323200, 1772323201], [1, 2]),  # a spreadsheet's date
        ("t,q_1\ns,rad\n0,1\nt,q_1\ns,rad\n1,2\n", [0, 1], [1, 2]),  # the logger was started again
        ("time_s,time_ns,q_1\n7,500000000,1\n8,20000000,2\n", [7.5, 8.02], [1, 2]),
        ("Time,q_1\n2026-03-01 00:00:00:500,1\n2026-03-01 00:00:01:000,2\n", [1772323200.5, 1772323201], [1, 2]),
        ("Time,q_1\n01-Mar-2026 00:00:00,1\n01-March-2026 00:00:01,2\n", [1772323200, 1772323201], [1, 2]),
        ("time,q_1\n0 days 00:00:00,1\n1 days 00:00:00.008000,2\n", [0, 86400.008], [1, 2]),
        ("Time,q_1\n0 sec,1\n0.008 sec,2\n", [0, 0.008], [1, 2]),
        ("t,q_1\n0,1000 mrad\n1,2000 mrad\n", [0, 1], [1, 2]),
        ("t,q_1,power\n0,1,----\n1,2,OR\n", [0, 1], [1, 2]),
        ("t,position\n0,[1. 9.]\n1,[2. 9.]\n", [0, 1], [1, 2]),
        ('t,position,position_0\n0,"[9, 9]",1\n1,"[9, 9]",2\n', [0, 1], [1, 2]),
        ("t\tposition\n0\t[1,0; 9]\n1\t[2,0; 9]\n", [0, 1], [1, 2]),
        ("t,q_1\n40000.0001,1\n40000.0002,2\n", [40000.0001, 40000.0002], [1, 2]),  # 10 kHz, no date
        ("Uhrzeit;sec;q_1\n12:00:01;5;1\n12:00:02;5;2\n", [43201, 43202], [1, 2]),  # of each step
        ("t,q_1\n0,1\n0,1\n1,2\n1,2\n", [0, 1], [1, 2]),  # polled faster than values came
        ("t / s,q_1 / mrad\n0,1000\n1,2000\n", [0, 1], [1, 2]),
        ("time [msec];q_1 [radians]\n0;1\n20;2\n", [0, 0.02], [1, 2]),
        ("time_usec,q_1 rad\n0,1\n20000,2\n", [0, 0.02], [1, 2]),
        ("t;q_1;U\ns;rad;V\n0;1;48\n1;2;48\n", [0, 1], [1, 2]),  # V is no unit of an arm
        ("t;q_1;state\nTime;Axis 1;Mode\n[s];[rad];\n0;1;3\n1;2;3\n", [0, 1], [1, 2]),
        ("t,q_1\n1,2\n0.5,1.5\n0,1\n", [0, 0.5, 1], [1, 1.5, 2]),  # the newest row first
        ("t,position,position.1\n0,1,9\n1,2,9\n", [0, 1], [1, 2]),  # names that pandas numbered
        ("t,q,q\n0,1,9\n1,2,9\n", [0, 1], [1, 2]),
        ("t,\tq_1\n0,\t1\n1,\t2\n", [0, 1], [1, 2]),
        ("time,q_1\n59:59.5,1\n00:00.5,2\n", [3599.5, 3600.5], [1, 2]),  # minutes of a spreadsheet
        ('t,position\n0,"tensor([[1., 9.]], device=\'cuda:0\')"\n1,"tensor([[2., 9.]])"\n', [0, 1], [1, 2]),
        ('t,position\n0,"array([1., 9.], dtype=float32)"\n1,"array([2., 9.])"\n', [0, 1], [1, 2]),
        ("time,q_1\n2026-03-01T01:00:00.5+01:00,1\n2026-03-01T00:00:01Z,2\n", [1772323200.5, 1772323201], [1, 2]),
    ],
)
def test_ordinary_files(tmp_path: Path, text: str | bytes, time: list[float], q: list[float]) -> None:
    table = read(tmp_path, text)
    np.testing.assert_allclose(table.rising_time(), time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(table.needed("position", 1)[:, 0], q)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("7,500000000,,elbow,0.5\n8,20000000,,elbow,0.6\n", f"{NO_TABLE}: no names in its first row"),
        ('{"t": 0, "q": [1, 2]}\n', f"{NO_TABLE}: it is JSON, no table"),
        ("t;q_1\n0;1.5\n1;2,5\n", "column q_1 has decimal points and decimal commas, first '2,5' in row 3, column B"),
        (
            't,q_1\n0,"1,234"\n',
            "column q_1 may have decimal commas or digits in groups of three, first '1,234' in row 2",
        ),
        ("t;q_1;p\n0;1.234;0,5\n", "column q_1 may have decimal points or digits in groups of three, as other columns"),
        ("t;position\n0;[1,5 9]\n1;[2,5 9]\n", "column position[1] holds text, first '5 9' in row 2"),
        ("time,q_1\n12:00:00:9,1\n12:00:00:10,2\n", "column time holds text, first '12:00:00:9'"),
        (
            "t,q_1 [rad]\n0,90 deg\n",
            "column q_1 [rad] has values in deg, while its unit is rad, first '90 deg' in row 2",
        ),
        ("t;q_1;q_1\n0;1;2\n", "column q_1 is there 2 times, as columns B, C: keep one"),
        ('t;a;q_1\n\n0;x;1\n;;\n1;"a\nb";ERR\n', "column q_1 holds text, first 'ERR' in row 5, column C"),
        ("time,q_1\n3/1/2026 1:00:00,1\n3/2/2026 1:00:00,2\n", "column time holds dates with ambiguous day and month"),
        ("t,q_1\n", "has no rows"),
        ("q_1\n1\n", "no column t, timestamp or time for the time; there are: q_1"),
        ("t,q_1\n0,1\n1,1\n1,2\n", "column t does not rise from 1 to 1 s in row 4, column A"),
        ("noon,q_1\n0,1\n1,2\n", "no column t, timestamp or time"),
        ("", f"{NO_TABLE}: "),
        ("0.62,0.0\n0.63,0.0\n", f"{NO_TABLE}: no names in its first row"),
        (
            "t,q_1\n0,5,1,5\n1,2\n",
            f"{NO_TABLE}: row 2 has 4 cells, expected 2 as in the row of names: is one a decimal",
        ),
        ("t;q_1\n0;1\n1\n", f"{NO_TABLE}: row 3 has 1 cells, expected 2"),
        (b"PK\x03\x04xl/workbook.xml", f"{NO_TABLE}: it is a workbook or an archive, no text: save the sheet as CSV"),
        (b"t,q_1\n0,\0001\n1,2\n", f"{NO_TABLE}: it holds bytes of 0 and is no text"),
        (b"t,\x81q\n0,1\n", f"{NO_TABLE}: its encoding is not known: save it as UTF-8"),
        ('t;q_1\n0;"1\n1;2\n', f"{NO_TABLE}: the quotes that begin in row 2 are not closed"),
        ("# t, q_1\n#\n", f"{NO_TABLE}: it holds comments alone"),
    ],
)
def test_a_refusal_names_the_cell_in_one_line(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(RecordingError) as caught:
        table = read(tmp_path, text)
        table.rising_time(1)
        table.joints("position")
    assert str(caught.value).startswith(f"{tmp_path / 'a.csv'}: {message}")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("last", ["2", "2;-", "2;1.2e", '2"', '2;"1'])
def test_a_row_within_which_the_file_ends_is_left_out_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, last: str
) -> None:
    """Of a logger that was killed."""
    assert read(tmp_path, f"t;q_1\n0;1\n1;2\n{last}").needed("position", 1)[:, 0].tolist() == [1, 2]
    assert "row 4" in caplog.text
    assert read(tmp_path, "t;q_1\n0;1\n1;2").time.tolist() == [0, 1]


def test_rows_without_a_time_are_left_out_and_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    table = read(tmp_path, "t;q_1\n0;1\n;mean\n1;2\n;3\n".replace("mean", "9"))
    assert table.rising_time().tolist() == [0, 1]
    assert table.row(1) == 4
    assert "2 of 4 rows have no time and are left out, first row 3" in caplog.text
