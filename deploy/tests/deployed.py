"""The files of deploy/, loaded once for their tests."""

import yaml

from deploy.tests.commands import DEPLOY

README = (DEPLOY / "README.md").read_text(encoding="utf-8")
FLEET = (DEPLOY.parent / "docs" / "fleet.md").read_text(encoding="utf-8")
COMPOSE = yaml.safe_load((DEPLOY / "docker" / "compose.yaml").read_text(encoding="utf-8"))
DOCKERFILE = (DEPLOY / "docker" / "Dockerfile").read_text(encoding="utf-8")
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))


def manifests():
    folder = DEPLOY / "kubernetes"
    names = yaml.safe_load((folder / "kustomization.yaml").read_text())["resources"]
    texts = [(folder / name).read_text(encoding="utf-8") for name in names]
    return [document for text in texts for document in yaml.safe_load_all(text)]


MANIFESTS = {(manifest["kind"], manifest["metadata"]["name"]): manifest for manifest in manifests()}
SETS = {name: manifest for (kind, name), manifest in MANIFESTS.items()
        if kind in ("StatefulSet", "Deployment")}  # fmt: skip
PODS = {name: workload["spec"]["template"]["spec"] for name, workload in SETS.items()}
CONTAINERS = [
    container
    for pod in PODS.values()
    for container in [*pod.get("initContainers", []), *pod["containers"]]
]
