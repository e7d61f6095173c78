"""The manifests: schemas, references and the restricted permissions of pods."""

import re
import shutil
import subprocess

import pytest
import yaml

from minerva_bus.security.credentials import covers
from minerva_bus.security.keys import KeyFolder
from minerva_bus.wire.keys import is_name
from tests.deploy.commands import DEPLOY, in_markdown
from tests.deploy.deployed import CONTAINERS, MANIFESTS, OF_REGIONS, PODS, README, SETS, manifests
from tests.runtime.running import here
from tools.region_hosts import HOSTS, MOST, main, manifest


def test_manifests_are_of_their_schemas():
    validate = pytest.importorskip("kubernetes_validate")
    for each in [*manifests(), *manifests("kubernetes/regions")]:
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
        service = (OF_REGIONS | MANIFESTS)["Service", whole["spec"]["serviceName"]]
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


def test_pods_of_regions_are_named_like_regions_and_link_by_their_names():
    """A pod of a StatefulSet has the name of the set and a number."""
    regions, coordinator = (
        OF_REGIONS["StatefulSet", "region"],
        OF_REGIONS["StatefulSet", "coordinator"],
    )
    count = f"--regions={regions['spec']['replicas']}"
    (region,), (world,) = (
        each["spec"]["template"]["spec"]["containers"] for each in (regions, coordinator)
    )
    (name,) = region["env"]
    assert name["valueFrom"]["fieldRef"]["fieldPath"] == "metadata.name"
    assert count in region["args"]
    assert count in world["args"]
    assert f"--process=$({name['name']})" in region["args"]
    link, hub = (port["containerPort"] for port in region["ports"])
    service = regions["spec"]["serviceName"]
    assert f"--link=tls/$({name['name']}).{service}:{link}" in region["args"]
    assert f"--listen=tls/0.0.0.0:{hub}" in region["args"]
    for number in range(regions["spec"]["replicas"]):
        (host,) = PODS[f"rabbits-{number}"]["containers"]
        assert f"--connect=tls/region-{number}.{service}:{hub}" in host["args"]
    hosts = re.findall(r"keys issue (region-\d) --role region --host (\S+)", README)
    assert [host for host, _ in hosts] == [f"region-{n}" for n in range(4)]
    assert all({f"{host}.{service}", service} <= {*names.split(",")} for host, names in hosts)


def test_each_region_has_hosts_with_an_autoscaler_of_their_own():
    count = OF_REGIONS["StatefulSet", "region"]["spec"]["replicas"]
    assert HOSTS.read_text(encoding="utf-8") == manifest(count, MOST)
    policy = OF_REGIONS["NetworkPolicy", "rabbits"]["spec"]["podSelector"]["matchLabels"]
    selectors = []
    for number in range(count):
        name = f"rabbits-{number}"
        scaler = OF_REGIONS["HorizontalPodAutoscaler", name]["spec"]
        assert scaler["scaleTargetRef"] == {
            "apiVersion": "apps/v1",
            "kind": "Deployment",
            "name": name,
        }
        assert 1 <= scaler["minReplicas"] < scaler["maxReplicas"]
        # Applying the file again must not undo what the autoscaler has chosen.
        assert "replicas" not in SETS[name]["spec"]
        # A share of what each container requests.
        (host,) = PODS[name]["containers"]
        (metric,) = scaler["metrics"]
        assert metric["resource"]["name"] in host["resources"]["requests"]
        selectors.append(SETS[name]["spec"]["selector"]["matchLabels"])
        assert policy.items() <= SETS[name]["spec"]["template"]["metadata"]["labels"].items()
        assert is_name(f"{name}-5d8c7b9f4-x2x7k")  # of the family rabbits
    # A Deployment counts the pods that its selector finds, so they must differ.
    assert all(selectors.count(selector) == 1 for selector in selectors)


@pytest.mark.parametrize("words", [["--regions", "0"], ["--most", "0"]])
def test_a_world_has_a_region_and_a_host(monkeypatch, words):
    monkeypatch.setattr("sys.argv", ["region_hosts", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2


def test_regions_may_link_to_each_other_and_to_the_coordinator():
    policy = OF_REGIONS["NetworkPolicy", "region"]["spec"]
    ports = {
        (port["port"], rule["to"][0]["podSelector"]["matchLabels"]["app.kubernetes.io/name"])
        for rule in policy["egress"]
        if "namespaceSelector" not in rule["to"][0]
        for port in rule["ports"]
    }
    assert ports == {(7447, "coordinator"), (7450, "region")}
    assert [rule["ports"] for rule in policy["ingress"]] == [
        [{"protocol": "TCP", "port": port}] for port in (7450, 7460)
    ]
    hosts = OF_REGIONS["NetworkPolicy", "rabbits"]["spec"]
    assert hosts["egress"][0]["ports"] == [{"protocol": "TCP", "port": 7460}]


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
