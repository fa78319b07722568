import pytest
import yaml

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.reference import load, save


def test_what_is_saved_is_loaded(rich_reference, tmp_path):
    save(load(rich_reference), tmp_path / "again.yaml")
    assert (tmp_path / "again.yaml").read_text() == rich_reference.read_text()


def test_a_person_can_read_and_plot_it(reference):
    content = yaml.safe_load(reference.read_text())
    assert list(content) == ["cellwatt_reference", "robot", "arm", "power", "joints", "tasks", "power_model", "cycles"]
    (task,) = content["tasks"]
    (variant,) = task["variants"]
    interval = variant["intervals"][1]
    assert interval["moving"] == [2, 3]
    power = interval["power"]
    times = [power["start"] + k * power["step"] for k in range(len(power["mean"]))]
    assert times[0] == -0.2
    assert times[-1] == pytest.approx(interval["duration"] + 0.1, abs=0.03)
    assert set(interval["position"]) == {2, 3}
    assert max(map(len, reference.read_text().splitlines())) <= 140


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ModelError, match="no such file; learn one with `cellwatt reference`"):
        load(tmp_path / "nothing.yaml")


def interval(content):
    return content["tasks"][0]["variants"][0]["intervals"][0]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda c: c.update(cellwatt_reference=2), "found 2: this cellwatt reads version 1: learn it anew"),
        (
            lambda c: interval(c).update(duration=-1.0),
            r"tasks\[0\]\.variants\[0\]\.intervals\[0\]\.duration: found -1.0, expected a value above 0",
        ),
        (lambda c: interval(c)["power"]["mean"].append(1.0), "mean and spread must have the same length"),
    ],
)
def test_a_wrong_file_is_refused_with_the_place(reference, tmp_path, change, text):
    content, path = yaml.safe_load(reference.read_text()), tmp_path / "changed.yaml"
    change(content)
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ModelError, match=text) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
