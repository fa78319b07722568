import shutil
from datetime import date

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import ConfigError
from cellwatt.record import Header, Recorder, RecordSettings
from cellwatt.tables import read_table, write_table
from cellwatt_plugins.fleet.lake import find, monday, week_of
from cellwatt_plugins.fleet.weekly import week_of_cell
from tests.blocks import frames_of, layout_of
from tests.plugins.robot import scara


def historians(table, begin):
    """The same samples as the historian's lake has them: channels of a source, and UTC times."""
    ns = (begin + table.time * 1e9).astype(np.int64)
    columns = {"time": pa.array(ns, pa.timestamp("ns", tz="UTC")), "session": pa.array(np.zeros(len(ns), np.int64))}
    for i in range(6):
        columns[f"arm.joint_{i + 1}.position"] = table.columns[f"q_{i + 1}"]
        columns[f"arm.joint_{i + 1}.torque"] = table.columns[f"tau_{i + 1}"]
    return pa.table(columns | {"supply.power": table.columns["power"]})


def test_a_lake_of_the_historian_gives_the_same_as_files(lake, tmp_path):
    source = next((lake / "weld" / "weld-0").glob("*.parquet"))
    day = source.name[:10]
    folder = tmp_path / "frames" / "site=plant-1" / "cell=weld-0" / f"day={day}"
    folder.mkdir(parents=True)
    begin = int(np.datetime64(day).astype("datetime64[ns]").astype(np.int64))
    pq.write_table(historians(read_table(source), begin), folder / "1795222800000000000_0_29999.parquet")
    (tmp_path / "energies" / "cell=weld-0").mkdir(parents=True)
    shutil.copy(source, tmp_path / "energies" / "cell=weld-0" / "x.parquet")
    own = next(item for item in find(lake).weeks if source in item.files)
    described = tmp_path.with_name("site=plant-1")
    described.symlink_to(lake / "weld")
    for pattern in ("", "weld-*="):
        (item,) = find(tmp_path, [f"{pattern}{described}"]).weeks
        assert (item.cell, item.week) == ("weld-0", own.week)
    one, other = week_of_cell(item), week_of_cell(type(own)(own.cell, own.robot, own.week, (source,)))
    assert len(one.repetitions) == 2
    assert one.coulomb == pytest.approx(other.coulomb, rel=1e-3)
    assert one.repetitions[0].energy == pytest.approx(other.repetitions[0].energy, rel=1e-3)


def test_the_friction_of_a_week_is_that_of_the_arm(lake):
    from fleet.emulated import Arm, Life

    week = week_of_cell(find(lake).weeks[0])
    life = Life(Arm("weld-0", "weld", 40), 12)
    heat = np.mean([repetition.temperature for repetition in week.repetitions], axis=0)
    true = life.coulomb * (1 - 0.003 * (heat - 28))
    true += life.viscous * np.exp(-life.thinner * (heat - 28)) * week.speed**0.95
    true *= life.gain * np.exp(life.wander[0])
    assert week.coulomb + week.viscous * week.speed == pytest.approx(true, rel=0.1)


def test_last_weeks_cells_of_one_name_and_descriptions_of_one_name(lake, tmp_path):
    assert {item.week for item in find(lake, last=6).weeks} == {week_of(date(2026, 2, 16)) + i for i in range(6)}
    for hall in ("north", "south"):
        folder = tmp_path / hall / "weld-1"
        folder.mkdir(parents=True)
        (folder / "2026-01-05.csv").write_text("t,q_1\n0,1\n1,2\n")
        for own in ("robot.yaml", "robot.urdf"):
            shutil.copy(lake / "weld" / own, tmp_path / hall)
    assert [item.cell for item in find(tmp_path).weeks] == ["north/weld-1", "south/weld-1"]
    changed = (tmp_path / "north" / "robot.yaml").read_text().replace("standby_power: 180", "standby_power: 90")
    (tmp_path / "north" / "robot.yaml").write_text(changed)
    with pytest.raises(ConfigError, match="give it another name"):
        find(tmp_path)


async def recorded(folder, table, begin, session):
    """The samples as a recording of a daemon that was started at ``session``, ns."""
    units = {"position": "rad", "torque": "Nm"}
    layout = layout_of({f"arm.joint_{i + 1}.{what}": unit for what, unit in units.items() for i in range(6)})
    values = np.column_stack([table.columns[f"{what}_{i + 1}"] for what in ("q", "tau") for i in range(6)])
    time = begin + np.round(table.time * 1e9).astype(np.int64)
    recorder = Recorder(RecordSettings(folder=folder), Header("plant-1", "weld-0", session))
    recorder.start()
    assert recorder.put(frames_of(layout, 0, time, values))
    await recorder.close()


async def test_a_recording_belongs_to_the_week_in_which_it_began_not_its_daemon(lake, tmp_path):
    source = next((lake / "weld" / "weld-0").glob("*.parquet"))
    day = np.datetime64("2026-03-04T10:00:00", "ns").astype(np.int64)
    folder = tmp_path / "weld-0"
    await recorded(folder, read_table(source), int(day), int(day) - 60 * 86_400 * 10**9)
    (folder / "x.mcap.sig").touch()
    shutil.copytree(folder, folder / "evidence")
    found = find(tmp_path, [str(lake / "weld")])
    (item,) = found.weeks
    assert (item.cell, monday(item.week)) == ("weld-0", date(2026, 3, 2))
    week = week_of_cell(item)
    assert found.skipped == [] and week.skipped == ()
    assert len(week.repetitions) == 2


def test_the_friction_of_a_slide_whose_strokes_are_slow(tmp_path):
    """15 mm in 1 s: no faster than 28 mm/s."""
    t = np.arange(125) / 125
    there = (10 * t**3 - 15 * t**4 + 6 * t**5)[:, None] * [0.5, 0.3, -0.015]
    way = np.concatenate([there, there[-1:].repeat(50, axis=0), there[::-1], np.zeros((50, 3))])
    q = np.array([0.3, 0.5, 0.1]) + np.tile(way, (12, 1))
    qd = np.gradient(q, 1 / 125, axis=0)
    tau = scara.torque(q, qd, np.gradient(qd, 1 / 125, axis=0))
    scara.write(tmp_path)
    columns = {f"{name}_{j + 1}": rows[:, j] for name, rows in (("q", q), ("tau", tau)) for j in range(3)}
    (tmp_path / "cell-1").mkdir()
    write_table(tmp_path / "cell-1" / "2026-01-05.parquet", {"t": np.arange(len(q)) / 125, **columns})
    week = week_of_cell(find(tmp_path).weeks[0])
    assert week.coulomb == pytest.approx(scara.FRICTION, rel=0.05)
    assert len(week.repetitions) == 11
