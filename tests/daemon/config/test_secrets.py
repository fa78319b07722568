"""A secret that is written into the file is told nowhere."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner
from pydantic import BaseModel, Field, SecretStr

from cellwatt.commands.check import command
from cellwatt.config import CellConfig, load, public_config, read_settings
from cellwatt.config.cell import FrameSettings
from cellwatt.config.document import read
from cellwatt.config.fields import fields_of, models_in
from cellwatt.config.installed import installed
from cellwatt.config.loading import load_document
from cellwatt.config.secret import secrets_in
from cellwatt.errors import ConfigError
from cellwatt.record import Header, RecordSettings
from cellwatt.units import Units

pytestmark = pytest.mark.usefixtures("real_parts")

Load = Callable[..., CellConfig]
SECRET = "hunter2-Zürich"
HEAD = "site: a\ncell: b\n"
ABB = "sources:\n  arm:\n    driver: abb\n    host: 192.0.2.1\n    "
UR = f"{HEAD}sources: {{arm: {{driver: ur, host: h}}}}\n"
OPTIONS = f"{UR}zenoh:\n  options:\n    "


FORMS = {
    "plain": f"{HEAD}{ABB}password: {SECRET}\n",
    "escaped": f'{HEAD}{ABB}password: "hunter2\\x2dZ\\u00fcrich"\n',
    "block": f"{HEAD}{ABB}password: >-\n      {SECRET}\n    user: x\n",
    "anchor": f"{HEAD}{ABB}password: &pw {SECRET}\n  two: {{driver: abb, host: i, egm_port: 6599, password: *pw}}\n",
    "merged": f"{HEAD}sources:\n  arm: &x {{driver: abb, host: h, password: {SECRET}}}\n  two: {{<<: *x, host: i}}\n",
    "tag": f"{HEAD}{ABB}password: !!str {SECRET}\n",
    "beside a variable": f"{HEAD}{ABB}password: {SECRET}${{ABB_PASSWORD:-}}\n",
    "comment": f"# the password is {SECRET}\n{HEAD}{ABB}password: {SECRET}\n",
    "Zenoh": f"{UR}zenoh: {{user: u, password: {SECRET}}}\n",
    "Zenoh's option": f"{OPTIONS}transport/auth/usrpwd/user: u\n    transport/auth/usrpwd/password: {SECRET}\n",
    "Zenoh's nested option": f"{OPTIONS}transport/auth: {{usrpwd: {{user: u, password: {SECRET}}}}}\n",
}


@pytest.mark.parametrize("text", FORMS.values(), ids=FORMS)
def test_a_secret_in_the_file_is_not_in_what_is_kept_or_published(load_text: Load, text: str) -> None:
    config = load_text(text)
    header = Header(config.site, config.cell, 0, settings=config.text).to_json()
    for told in (config.text, header, json.dumps(public_config(config), ensure_ascii=False), repr(config)):
        assert SECRET not in told
        assert "hunter2" not in told
    assert '"***"' in config.text
    # What else the file says is kept: replay reads it again.
    before, after = yaml.safe_load(text), yaml.safe_load(config.text)
    secrets = [path for path in paths(before) if "password" in str(path[-1])]
    assert [path for path in paths(after) if at(after, path) != at(before, path)] == secrets
    assert load_text(config.text).cell == "b"


def test_a_secret_that_is_a_word_of_the_file_leaves_it_yaml(load_text: Load) -> None:
    """The maker's own password of an ABB arm, for instance."""
    arm = "{driver: abb, host: &robotics h, user: u, password: robotics}"
    cell = f"site: robotics-plant\ncell: robotics\nsources:\n  robotics: {arm}\n"
    text = load_text(f"# robotics: the maker's\n{cell}").text
    assert text.startswith("# ***: the maker's\n")
    told = yaml.safe_load(text)
    assert (told["site"], told["cell"]) == ("***-plant", "***")
    assert told["sources"]["robotics"] == yaml.safe_load(arm) | {"password": "***"}


def paths(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    if not isinstance(tree, dict):
        return [path]
    return [p for key, value in tree.items() for p in paths(value, (*path, key))]


def at(tree: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        tree = tree[key]
    return tree


def test_a_recipient_may_be_named_like_its_channel(tmp_path: Path) -> None:
    web = {"url": f"https://{SECRET}.example", "ca": "ca.pem"}
    ntfy = {"url": "https://ntfy.example", "topic": "hunter2", "token": SECRET}
    cell = {"site": "a", "cell": "b", "sources": {"arm": {"driver": "ur", "host": "h"}}}
    cell["notify"] = {"to": {"ntfy": {"ntfy": ntfy}, "webhook": {"webhook": web}}}
    config = load_document(read(tmp_path / "cell.yaml", {}, text=json.dumps(cell)))
    assert "hunter2" not in config.text + json.dumps(public_config(config))
    settings: Any = config.outlets["notify"].settings
    assert settings.to["webhook"].webhook.ca == tmp_path / "ca.pem"


def test_the_name_of_a_variable_is_no_secret_and_the_device_gets_its_value(load_text: Load) -> None:
    config: Any = load_text(f"{HEAD}{ABB}password: ${{ABB_PASSWORD}}\n", ABB_PASSWORD=SECRET)
    assert config.sources["arm"].settings.password.get_secret_value() == SECRET
    assert "${ABB_PASSWORD}" in config.text
    assert public_config(config)["sources"]["arm"]["password"] == "${ABB_PASSWORD}"


MISTAKES = {
    "a list": f"{HEAD}{ABB}password: [73517351]\n",
    "without user": f"{UR}zenoh: {{password: p73517351}}\n",
    "an option": f"{UR}zenoh: {{options: {{transport/auth/usrpwd/password: [p73517351]}}}}\n",
    "a nested option": f"{UR}zenoh: {{options: {{transport/auth/usrpwd: {{password: [p73517351]}}}}}}\n",
    "an endpoint": UR + "zenoh: {connect: ['tls/h:7447#connect_private_key_base64=p73517351'], tls: {root_ca: x}}\n",
}


@pytest.mark.parametrize("text", MISTAKES.values(), ids=MISTAKES)
def test_a_wrong_secret_is_not_repeated(tmp_path: Path, text: str) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load(file, {})
    assert "73517351" not in str(caught.value)
    for arguments in ([str(file)], ["--json", str(file)]):
        done = CliRunner().invoke(command, arguments)
        assert done.exit_code == 2
        assert "73517351" not in done.output


class Login(BaseModel):
    password: SecretStr = Field(min_length=20)


class Logins(BaseModel):
    logins: dict[str, Login]


def test_a_wrong_secret_of_any_file_is_not_repeated(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(f"logins: {{ann: {{password: {SECRET}}}}}\n")
    with pytest.raises(ConfigError, match=r"found \*\*\*, expected at least 20") as caught:
        read_settings(tmp_path / "map.yaml", Logins)
    assert SECRET not in str(caught.value)


def test_every_setting_that_sounds_like_a_secret_is_declared_as_one() -> None:
    for part in installed():
        for name, field in part.settings.model_fields.items() if part.settings is not None else ():
            if any(word in name for word in ("password", "secret", "token", "passphrase")):
                assert list(secrets_in(part.settings, {name: "x"}, ())) == [(name,)], f"{part.name}.{name}: {field}"


MARK = "hunter2MARK"
ADDRESSES = (
    f"mqtt://u:{MARK}@plant:1883/x",
    f"https://plant/{'a' * 50}?part=1&X-Amz-Signature={MARK}",
    f"u:{MARK}@192.0.2.1",
    f"https://{MARK}{'b' * 80}@plant",
)


def settings_with(kind: Any, address: str, depth: int = 0) -> Iterator[Any]:
    """Values for a settings class, each with a marked address in one place; in secrets the mark alone."""
    for key, field in fields_of(kind).items():
        if list(secrets_in(kind, {key: "x"}, ())):
            yield {key: MARK}
            continue
        yield from ({key: value} for value in within(field.annotation, address))
        for inner in models_in(field.annotation) if depth < 3 else ():
            for value in settings_with(inner, address, depth + 1):
                yield {key: within(field.annotation, value)[-1]}


def within(annotation: Any, value: Any) -> list[Any]:
    """A value as it is, and in the list or mapping that a setting holds."""
    held = str(annotation)
    return [value, *([[value]] if "tuple[" in held else []), *([{"x": value}] if "Mapping[" in held else [])]


SECTIONS = {"record": RecordSettings, "frames": FrameSettings, "units": Units}


def cells_with(address: str) -> Iterator[dict[str, Any]]:
    head = {"site": "a", "cell": "b", "sources": {"arm": {"driver": "ur", "host": "h"}}}
    for key in ("site", "cell", "robot", "latency", "version", address):
        yield {**head, key: address}
    for part in installed():
        for value in settings_with(part.settings, address) if part.settings is not None else ():
            match part.kind:
                case "driver":
                    yield {**head, "sources": {"arm": {"driver": part.name, **value}}}
                case "stage":
                    yield {**head, "stages": {"one": {"stage": part.name, **value}}}
                case "outlet":
                    yield {**head, part.name: value}
    for name, kind in SECTIONS.items():
        for value in settings_with(kind, address):
            yield {**head, name: value}


@pytest.mark.parametrize("address", [ADDRESSES[0], *(pytest.param(a, marks=pytest.mark.slow) for a in ADDRESSES[1:])])
def test_a_secret_in_any_setting_of_any_kind_is_told_nowhere(tmp_path: Path, address: str) -> None:
    """What the mark is in: messages of ``check``, what is recorded, published and bundled, warnings in the log."""
    file, tried, right = tmp_path / "cell.yaml", 0, 0
    for cell in cells_with(address):
        text = json.dumps(cell)
        try:
            config = load_document(read(file, {}, text=text))
        except ConfigError as error:
            told = [str(error)]
        else:
            right += 1
            told = [config.text, json.dumps(public_config(config)), *config.warnings]
        for part in told:
            assert MARK not in part, text
        tried += 1
    assert tried > 300
    assert right > 10
