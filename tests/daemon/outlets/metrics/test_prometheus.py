"""Prometheus' promtool checks what we tell and ship."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml

from cellwatt.outlets.metrics.catalogue import CATALOGUE
from cellwatt.outlets.metrics.outlet import exposed
from tests.daemon.outlets.metrics.cell import outlet_of, tell_everything, told

PROMTOOL = shutil.which("promtool")
SHIP = Path(str(files("cellwatt.outlets.metrics"))) / "ship"
TOLD = {told(family): family for family in CATALOGUE.values()}
ELSEWHERE = {"up"}
"""Metrics that Prometheus makes itself."""

checks = pytest.mark.skipif(PROMTOOL is None, reason="promtool is not installed (apt-get install prometheus)")


def promtool(*arguments: str, text: bytes = b"") -> str:
    done = subprocess.run([str(PROMTOOL), *arguments], input=text, capture_output=True, check=False)
    said = (done.stdout + done.stderr).decode()
    assert done.returncode == 0, said
    return said


def full_text() -> bytes:
    outlet = outlet_of()
    tell_everything(outlet)
    return exposed(outlet._meter, "")[0]


@checks
def test_promtool_finds_nothing_to_say_about_the_metrics() -> None:
    assert promtool("check", "metrics", text=full_text()) == ""


@checks
def test_alert_rules_fire_when_they_should(tmp_path: Path) -> None:
    tests = yaml.safe_load(Path(__file__).with_name("alerts_test.yaml").read_text())
    tests["rule_files"] = [str(SHIP / "alerts.yaml")]
    file = tmp_path / "alerts_test.yaml"
    file.write_text(yaml.safe_dump(tests))
    assert "SUCCESS" in promtool("test", "rules", str(file))
    cases = [case for test in tests["tests"] for case in test["alert_rule_test"]]
    fired = {case["alertname"] for case in cases if case.get("exp_alerts")}
    silent = {case["alertname"] for case in cases if not case.get("exp_alerts")}
    assert fired == silent == {rule["alert"] for rule in rules()}


def rules() -> list[dict[str, Any]]:
    (group,) = yaml.safe_load((SHIP / "alerts.yaml").read_text())["groups"]
    found: list[dict[str, Any]] = group["rules"]
    return found


def metrics_in(query: str) -> set[str]:
    """Names of metrics in a query: words that are neither functions, nor keywords, nor labels."""
    bare = re.sub(r'"[^"]*"', "", query)
    bare = re.sub(r"\b(?:by|without|ignoring|on)\s*\([^)]*\)", "", bare)
    bare = re.sub(r"\{[^}]*\}|\[[^\]]*\]", "", bare)
    words = set(re.findall(r"[a-zA-Z_:][\w:]*(?!\s*\(|[\w:])", bare))
    return words - {"sum", "count", "by", "without", "or", "and", "unless", "ignoring", "on"}


def labels_in(query: str) -> Iterator[tuple[str, set[str]]]:
    for name, selector in re.findall(r"(cellwatt_\w+)\{([^}]*)\}", query):
        yield name, set(re.findall(r"(\w+)\s*(?:=~?|!=|!~)", re.sub(r'"[^"]*"', "", selector)))


def dashboard_queries() -> list[str]:
    board = json.loads((SHIP / "dashboard.json").read_text())
    queries = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    for variable in board["templating"]["list"]:
        if variable["type"] == "query":
            queries += re.findall(r"label_values\((\w+),", variable["query"]["query"])
    return queries


def test_queries_name_only_metrics_that_there_are() -> None:
    queries = [*dashboard_queries(), *(rule["expr"] for rule in rules())]
    assert len(queries) > 25
    for query in queries:
        named = metrics_in(query)
        assert named, query
        assert named <= TOLD.keys() | ELSEWHERE, f"{query}: {named - TOLD.keys() - ELSEWHERE}"
        for name, labels in labels_in(query):
            assert labels <= {*TOLD[name].labels, "site", "cell", "job", "instance"}, query


@checks
def test_dashboard_queries_are_promql(tmp_path: Path) -> None:
    queries = [query.replace("$site", "a").replace("$cell", "b") for query in dashboard_queries()]
    recorded = [{"record": f"q{n}", "expr": query} for n, query in enumerate(queries)]
    file = tmp_path / "queries.yaml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "dashboard", "rules": recorded}]}))
    promtool("check", "rules", str(file))
