"""The manifests: schemas, references and the restricted permissions of pods."""

import re
import shutil
import subprocess

import pytest
import yaml

from deploy.tests.commands import DEPLOY, in_markdown
from deploy.tests.deployed import CONTAINERS, MANIFESTS, PODS, README, SETS, manifests
from minerva_bus.security.credentials import covers
from minerva_bus.wire.keys import is_name
from minerva_certificates.key_folder import KeyFolder
from tests.runtime.running import here


def test_manifests_are_of_their_schemas():
    validate = pytest.importorskip("kubernetes_validate")
    for each in manifests():
        validate.validate(each, validate.latest_version(), strict=True)


@pytest.mark.parametrize("container", CONTAINERS, ids=lambda container: container["name"])
def test_pods_may_do_little(container):
    confined = container["securityContext"]
    assert confined["allowPrivilegeEscalation"] is False
    assert confined["readOnlyRootFilesystem"] is True
    assert confined["capabilities"] == {"drop": ["ALL"]}
    assert container["resources"]["requests"].keys() == {"cpu", "memory"}
    assert "memory" in container["resources"]["limits"]


@pytest.mark.parametrize("name", PODS)
def test_references_of_pods_exist(name):
    pod, whole = PODS[name], SETS[name]
    assert pod["securityContext"]["runAsNonRoot"] is True
    assert pod["automountServiceAccountToken"] is False
    claims = whole["spec"].get("volumeClaimTemplates", [])
    volumes = {volume["name"] for volume in pod["volumes"]} | {
        claim["metadata"]["name"] for claim in claims
    }
    for container in [*pod.get("initContainers", []), *pod["containers"]]:
        mounted = {mount["name"] for mount in container["volumeMounts"]}
        assert mounted <= volumes
        ports = {port["name"] for port in container.get("ports", [])}
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            if probe in container:
                assert container[probe]["httpGet"]["port"] in ports
                assert container[probe]["httpGet"]["path"] in ("/live", "/ready")
    labels = whole["spec"]["template"]["metadata"]["labels"]
    assert whole["spec"]["selector"]["matchLabels"].items() <= labels.items()
    if whole["kind"] == "StatefulSet":
        service = MANIFESTS["Service", whole["spec"]["serviceName"]]
        assert service["spec"]["selector"].items() <= labels.items()


def test_a_coordinator_that_waits_is_not_restarted():
    (world,) = PODS["coordinator"]["containers"]
    assert world["livenessProbe"]["httpGet"]["path"] == "/live"
    assert world["readinessProbe"]["httpGet"]["path"] == "/ready"
    assert MANIFESTS["Service", "coordinator"]["spec"]["publishNotReadyAddresses"] is True


def test_secrets_are_those_that_the_page_makes():
    named = {volume["secret"]["secretName"] for pod in PODS.values() for volume in pod["volumes"]
             if "secret" in volume}  # fmt: skip
    assert named == set(re.findall(r"create secret generic (\S+)", README))


def test_names_that_the_page_scales_exist():
    scaled = re.findall(r"kubectl .*(?:scale|rollout status) (\w+) ([\w-]+)", README)
    assert ("deployment", "hosts") in scaled
    assert {(kind, SETS[name]["kind"].lower()) for kind, name in scaled} == {
        (kind, kind) for kind, _ in scaled
    }


def test_pods_of_a_deployment_are_of_the_family_that_the_page_issues(tmp_path):
    """The secret has the files that the page's commands put there; any pod name works."""
    section = README.partition("## Kubernetes")[2].partition("\n## ")[0]
    for words in in_markdown(section):
        assert here(tmp_path, *words).returncode == 0
    (files,) = re.findall(r"secret generic hosts-keys \$\((.*)\)", section)
    done = subprocess.run(["bash", "-c", files], cwd=tmp_path, capture_output=True, text=True)
    secret = tmp_path / "secret"
    secret.mkdir()
    for option in done.stdout.split():
        shutil.copy(tmp_path / option.removeprefix("--from-file="), secret)
    assert sorted(path.name for path in secret.iterdir()) == ["ca.pem", "hosts.key", "hosts.pem"]
    (host,) = PODS["hosts"]["containers"]
    (name,) = host["env"]
    assert name["valueFrom"]["fieldRef"]["fieldPath"] == "metadata.name"
    assert f"--name=$({name['name']})" in host["args"]
    assert SETS["hosts"]["kind"] == "Deployment"
    for pod in ("hosts-5d8c7b9f4-x2x7k", "hosts-" + "x" * 57):
        assert is_name(pod)
        assert KeyFolder(secret).credentials(pod).name == pod
        assert [right for right in KeyFolder(tmp_path / "keys").rights() if covers(right, pod)] == [
            "hosts-*"
        ]


def test_only_permitted_agents_communicate():
    nobody = MANIFESTS["NetworkPolicy", "nobody"]["spec"]
    assert nobody == {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}
    open_ports = {
        port["port"]
        for rule in MANIFESTS["NetworkPolicy", "coordinator"]["spec"]["ingress"]
        for port in rule["ports"]
    }
    ports = {port["containerPort"] for port in PODS["coordinator"]["containers"][0]["ports"]}
    assert open_ports == ports


def test_kustomize_puts_it_together():
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl is not here")
    done = subprocess.run(
        ["kubectl", "kustomize", str(DEPLOY / "kubernetes")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    made = list(yaml.safe_load_all(done.stdout))
    assert len(made) == len(MANIFESTS)
    images = re.findall(r"^\s+image: (\S+)$", done.stdout, re.M)
    assert set(images) == {"minerva-bus:local"}
