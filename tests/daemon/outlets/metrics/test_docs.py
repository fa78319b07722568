"""The page about Prometheus says what is so."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellwatt.outlets.metrics.catalogue import CATALOGUE
from tests.daemon.outlets.metrics.cell import told
from tests.daemon.outlets.metrics.test_prometheus import checks, promtool
from tests.docs.pages import ROOT, Block, blocks

PAGE = "outlets/prometheus.md"
YAML = blocks(PAGE, "yaml")


@checks
@pytest.mark.parametrize("block", [b for b in YAML if b.text.startswith("scrape_configs")], ids=str)
def test_prometheus_accepts_its_part(block: Block, tmp_path: Path) -> None:
    text = block.text
    for path in ("/etc/prometheus/cellwatt-token", "/etc/prometheus/plant-ca.pem"):
        (tmp_path / Path(path).name).touch()
        text = text.replace(path, str(tmp_path / Path(path).name))
    (tmp_path / "prometheus.yml").write_text(text)
    promtool("check", "config", "--syntax-only", str(tmp_path / "prometheus.yml"))


def test_every_metric_is_in_the_table() -> None:
    text = (ROOT / "docs" / PAGE).read_text()
    for family in CATALOGUE.values():
        labels = ", ".join(f"`{label}`" for label in family.labels)
        assert f"| `{told(family)}` | {labels} | {family.help} |" in text


def test_the_folder_of_what_is_shipped(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = blocks(PAGE, "python")
    exec(compile(block.text, block.page, "exec"), {})
    folder = Path(capsys.readouterr().out.strip())
    assert {path.name for path in folder.iterdir()} == {"alerts.yaml", "dashboard.json"}
