"""Hosts for each region on Kubernetes: a Deployment and its autoscaler, as one manifest.

    python -m tools.region_hosts [--regions 4] [--most 8] [--write]

`--regions` is the number of regions of the world, `--most` that of the hosts of one region.
`--write` replaces deploy/kubernetes/regions/hosts.yaml, which tests compare with that of four
regions; without it, the manifest is printed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

HOSTS = Path(__file__).parents[1] / "deploy" / "kubernetes" / "regions" / "hosts.yaml"
REGIONS = 4
MOST = 8

HEAD = """\
# Hosts of rabbits for each region, with an autoscaler that looks at the hosts of this region alone.
# They are scaled while the world runs. If those of a region compute for more than 70 % of the time,
# another one joins and takes a share of the agents; those of one that leaves evolve on the others.
#
#     python -m tools.region_hosts --regions {regions} --most {most} > hosts.yaml
#
# All share one certificate, of the family rabbits. The autoscalers need the metrics server of the
# cluster. To choose the number yourself, delete the autoscaler of a region, and scale:
#
#     kubectl --namespace minerva-regions delete horizontalpodautoscaler rabbits-0
#     kubectl --namespace minerva-regions scale deployment rabbits-0 --replicas 3
"""

DEPLOYMENT = """\
apiVersion: apps/v1
kind: Deployment
metadata:
  name: rabbits-{number} # pods' names begin with that of the family
spec: # without replicas: the autoscaler has their number
  selector:
    matchLabels: {{ app.kubernetes.io/name: rabbits, app.kubernetes.io/component: region-{number} }}
  template:
    metadata:
      labels: {{ app.kubernetes.io/name: rabbits, app.kubernetes.io/component: region-{number} }}
    spec:
      automountServiceAccountToken: false
      enableServiceLinks: false
      terminationGracePeriodSeconds: 15
      securityContext:
        runAsNonRoot: true
        runAsUser: 10001
        runAsGroup: 10001
        fsGroup: 10001
        seccompProfile: {{ type: RuntimeDefault }}
      topologySpreadConstraints:
        - maxSkew: 1
          topologyKey: kubernetes.io/hostname
          whenUnsatisfiable: ScheduleAnyway
          labelSelector:
            matchLabels: {{ app.kubernetes.io/name: rabbits }}
      containers:
        - name: host
          image: minerva-bus
          args:
            - attach
            - meadow
            - --process=rabbits-1
            - --name=$(NAME)
            - --world=meadow
            - --connect=tls/region-{number}.region:7460
            - --keys=/etc/minerva/keys
          env:
            - name: NAME
              valueFrom: {{ fieldRef: {{ fieldPath: metadata.name }} }}
          resources:
            requests: {{ cpu: "1", memory: 256Mi }}
            limits: {{ memory: 1Gi }}
          securityContext:
            allowPrivilegeEscalation: false
            readOnlyRootFilesystem: true
            capabilities: {{ drop: [ALL] }}
          volumeMounts:
            - {{ name: keys, mountPath: /etc/minerva/keys, readOnly: true }}
            - {{ name: tmp, mountPath: /tmp }}
      volumes:
        - name: keys
          secret: {{ secretName: rabbits-keys, defaultMode: 0440 }}
        - name: tmp
          emptyDir: {{ medium: Memory, sizeLimit: 64Mi }}
"""

AUTOSCALER = """\
apiVersion: autoscaling/v2
kind: HorizontalPodAutoscaler
metadata:
  name: rabbits-{number}
spec:
  scaleTargetRef: {{ apiVersion: apps/v1, kind: Deployment, name: rabbits-{number} }}
  minReplicas: 1
  maxReplicas: {most}
  metrics:
    - type: Resource
      resource:
        name: cpu # a host computes in one thread
        target: {{ type: Utilization, averageUtilization: 70 }}
  behavior:
    scaleDown:
      stabilizationWindowSeconds: 300 # agents move when a host leaves
"""


def manifest(regions: int, most: int) -> str:
    """The manifest for a number of regions, each with up to `most` hosts."""
    parts = [
        part.format(number=number, most=most)
        for number in range(regions)
        for part in (DEPLOYMENT, AUTOSCALER)
    ]
    return HEAD.format(regions=regions, most=most) + "---\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--regions", type=int, default=REGIONS)
    parser.add_argument("--most", type=int, default=MOST, help="hosts of one region")
    parser.add_argument("--write", action="store_true", help=f"replace {HOSTS.name}")
    given = parser.parse_args()
    if given.regions < 1 or given.most < 1:
        parser.error("--regions and --most are at least 1")
    text = manifest(given.regions, given.most)
    if given.write:
        HOSTS.write_text(text, encoding="utf-8")
    else:
        print(text, end="")


if __name__ == "__main__":
    main()
