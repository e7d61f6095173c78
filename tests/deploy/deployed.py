"""The files of deploy/, loaded once for their tests."""

import yaml

from tests.deploy.commands import DEPLOY

README = (DEPLOY / "README.md").read_text(encoding="utf-8")
FLEET = (DEPLOY.parent / "docs" / "fleet.md").read_text(encoding="utf-8")
COMPOSE = yaml.safe_load((DEPLOY / "docker" / "compose.yaml").read_text(encoding="utf-8"))
DOCKERFILE = (DEPLOY / "docker" / "Dockerfile").read_text(encoding="utf-8")
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))


def manifests(folder="kubernetes"):
    names = yaml.safe_load((DEPLOY / folder / "kustomization.yaml").read_text())["resources"]
    texts = [(DEPLOY / folder / name).read_text(encoding="utf-8") for name in names]
    return [one for text in texts for one in yaml.safe_load_all(text)]


MANIFESTS = {(one["kind"], one["metadata"]["name"]): one for one in manifests()}
# Those of a world in regions, whose coordinator has the same name in another namespace.
OF_REGIONS = {
    (one["kind"], one["metadata"]["name"]): one for one in manifests("kubernetes/regions")
}
COMPOSED_REGIONS = yaml.safe_load((DEPLOY / "docker" / "regions.yaml").read_text(encoding="utf-8"))
SETS = {name: one for (kind, name), one in (OF_REGIONS | MANIFESTS).items()
        if kind in ("StatefulSet", "Deployment")}  # fmt: skip
PODS = {name: one["spec"]["template"]["spec"] for name, one in SETS.items()}
CONTAINERS = [
    one for pod in PODS.values() for one in [*pod.get("initContainers", []), *pod["containers"]]
]
