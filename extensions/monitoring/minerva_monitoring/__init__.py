"""Running worlds in Prometheus, for orchestrators, and in the terminal.

metrics_server       /metrics, /live and /ready over HTTP, for `minerva metrics` and `--metrics`
prometheus_metrics   the metrics of one world, from its status and its totals
top_dashboard        `minerva top`: a world in the terminal, with keys to operate it
top_texts            its heading, rows, bars and panels
top_charts           the courses of collected series
"""
