"""Metrics and health of running worlds, for Prometheus and for orchestrators.

metrics_server       /metrics, /live and /ready over HTTP, for `minerva metrics` and `--metrics`
prometheus_metrics   the metrics of one world, from its status and its totals
"""
