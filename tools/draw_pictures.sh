#!/usr/bin/env bash
# Makes the pictures of the README and the guides: run in the project's folder, with its environment.
set -euo pipefail
minerva run robot --view svg:path=docs/robot.svg
(cd examples/meadow && minerva run meadow.toml --rate 0 --frames 640 --view svg:path=../../docs/meadow.svg)
(cd examples/flock && minerva run flock.toml --rate 0 --frames 300 --view svg:path=../../docs/flock.svg)
rm docs/robot.svg docs/meadow.svg docs/flock.svg
