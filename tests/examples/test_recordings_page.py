"""docs/recordings.md does what it says."""

import shlex

from click.testing import CliRunner

from cellwatt.commands import cli
from tests.docs.pages import Block, blocks

FOLDER = "/var/lib/cellwatt/weld-3"


def mine(language: str) -> list[Block]:
    """The blocks of the page that this test runs."""
    return [block for block in blocks("recordings.md", language) if "test_recordings_page" in block.note]


def test_the_commands_and_programs_of_the_page_run(workspace):
    (file,) = workspace.glob("rec/*.mcap")
    commands = [line for block in mine("sh") for line in block.commands()]
    assert commands
    for line in commands:
        words = shlex.split(line.replace(FOLDER, "rec").replace("FILE", str(file)), comments=True)
        done = CliRunner().invoke(cli, words[1:])
        assert done.exit_code == 0, done.output
    names = {}
    for block in mine("python"):
        exec(compile(block.text.replace(FOLDER, "rec"), block.page, "exec"), names)
    assert "position.html" in {path.name for path in workspace.iterdir()}
    assert names["alarms"] and names["table"].shape == (200, 6)
