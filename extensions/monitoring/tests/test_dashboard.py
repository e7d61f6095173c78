"""The dashboard and the alerts query only metrics that exist."""

import json
import re

import pytest
import yaml

from deploy.tests.commands import DEPLOY
from deploy.tests.deployed import COMPOSE
from minerva_bus.runtime.metrics import Durations, Totals
from minerva_bus.world.operator import MemberStatus, WorldStatus

DASHBOARD = json.loads((DEPLOY / "grafana" / "minerva.json").read_text(encoding="utf-8"))
RULES = yaml.safe_load((DEPLOY / "prometheus" / "rules.yaml").read_text(encoding="utf-8"))


def exported():
    """Names and labels of all samples that a world exports."""
    pytest.importorskip("prometheus_client")
    from minerva_monitoring.prometheus_metrics import world_metrics

    totals = Totals(1, {"frame": Durations()}, {"eStep": 1}, 1, 1)
    status = WorldStatus("pond", 1, 0.1, "events", members=(MemberStatus("a", "present"),),
                         refused={"m": 1})  # fmt: skip
    names = {}
    for family in world_metrics(status, totals):
        for sample in family.samples:
            names.setdefault(sample.name, set()).update(sample.labels)
    return names


def expressions():
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            yield panel["title"], target["expr"]
    for group in RULES["groups"]:
        for rule in group["rules"]:
            yield rule["alert"], rule["expr"]
    for variable in DASHBOARD["templating"]["list"]:
        yield variable["name"], variable.get("definition", "")


@pytest.mark.parametrize(("title", "expression"), list(expressions()))
def test_expressions_are_of_figures_that_there_are(title, expression):
    names = exported()
    used = set(re.findall(r"\bminerva_\w+", expression))
    assert used or title == "datasource", "an expression without a figure"
    assert used <= names.keys()
    for name, matchers in re.findall(r"(minerva_\w+)\{([^}]*)\}", expression):
        labels = set(re.findall(r"(\w+)\s*(?:=~|!~|!=|=)", matchers))
        assert labels <= names[name], f"{name} has no such label"
    for labels in re.findall(r"\bby \(([^)]*)\)", expression):
        known = set().union(*(names[metric] for metric in used))
        assert set(re.findall(r"\w+", labels)) <= known
    assert expression.count("(") == expression.count(")")


def test_every_metric_of_trouble_is_shown():
    shown = " ".join(expression for _, expression in expressions())
    missing = {name for name in exported() if name not in shown}
    assert missing <= {
        "minerva_frame_phase_seconds_count",
        "minerva_simulated_seconds",
        "minerva_waiting_members",
    }


def test_panels_lie_beside_each_other():
    assert len({panel["id"] for panel in DASHBOARD["panels"]}) == len(DASHBOARD["panels"])
    taken = set()
    for panel in DASHBOARD["panels"]:
        place = panel["gridPos"]
        cells = {
            (place["x"] + i, place["y"] + j) for i in range(place["w"]) for j in range(place["h"])
        }
        assert not cells & taken, panel["title"]
        assert max(x for x, _ in cells) < 24
        taken |= cells


def test_panels_have_what_grafana_wants():
    assert DASHBOARD["schemaVersion"] >= 36
    variables = {variable["name"] for variable in DASHBOARD["templating"]["list"]}
    for panel in DASHBOARD["panels"]:
        assert panel["type"] in ("stat", "timeseries")
        assert panel["title"]
        assert panel["fieldConfig"]["defaults"]["unit"]
        assert len({target["refId"] for target in panel["targets"]}) == len(panel["targets"])
        used = re.findall(r"\$\{?(\w+)", json.dumps(panel))
        assert set(used) <= variables | {"__rate_interval"}


def test_prometheus_scrapes_the_coordinators_endpoint():
    config = yaml.safe_load((DEPLOY / "prometheus" / "prometheus.yaml").read_text())
    (target,) = config["scrape_configs"][0]["static_configs"][0]["targets"]
    name, _, port = target.partition(":")
    assert f"--metrics=0.0.0.0:{port}" in COMPOSE["services"][name]["command"]
    for file in config["rule_files"]:
        assert (DEPLOY / "prometheus" / file).is_file()
