#!/usr/bin/env bash
# Makes the pictures of the README and the guides: run in the project's folder, with its environment.
set -euo pipefail
export MINERVA_FORCE=1
minerva run robot --view svg:path=docs/robot.svg --record docs/robot.mcap
minerva plot docs/robot.mcap -o docs/record.png
(cd worlds/minerva_worlds/flock && minerva run flock.toml --rate 0 --frames 300 --view svg:path=../../../docs/flock.svg)
minerva run slime --frames 101 --view svg:path=docs/slime.svg,every=100
(cd worlds/minerva_worlds/crowd && minerva run crowd.toml --frames 200 --view sprites:path=../../../docs/crowd.png,every=100)
(cd worlds/minerva_worlds/plants && minerva run plants.toml --view svg:path=../../../docs/plants.svg,every=4)
(cd worlds/minerva_worlds/robots && minerva run robots.toml --frames 600 --view svg:path=../../../docs/robots.svg,every=50)
(cd worlds/minerva_worlds/village && minerva run village.toml --rate 0 --frames 260 --view svg:path=village.svg,width=900
    rm village.svg)
(cd worlds/minerva_worlds/evolution && minerva evolve forager.toml --fitness forager:berries --seed 1 \
    --mutable AEgg.speed=0:0.4 --mutable TAim --mutable TAim.angle=-180:180 \
    --mutable PEye --mutable PEye.left=-2:2 --mutable PEye.right=-2:2 \
    --population 20 --generations 14 --in-process --compare-random \
    -o foragers.toml --plot ../../../docs/evolution.png --tree ../../../docs/descent.png --quiet
    minerva run foragers.toml --view svg:path=../../../docs/foragers.svg
    rm foragers.toml)
(cd worlds/minerva_worlds/traffic && minerva run traffic.toml --rate 0 --frames 480 --view svg:path=../../../docs/traffic.svg,width=640
    minerva run traffic.toml --rate 0 --frames 480 --norms false --view svg:path=../../../docs/traffic-without.svg,width=640)
rm docs/robots.svg docs/robot.svg docs/flock.svg docs/foragers.svg docs/traffic.svg docs/traffic-without.svg docs/slime.svg docs/plants.svg docs/robot.mcap

minerva run robot --robots 2 --rate 30 --until '' --quiet &
trap 'kill %1' EXIT
until minerva list --world robot >/dev/null 2>&1; do sleep 0.2; done
python tools/draw_top.py docs/top.png
minerva stop robot
trap - EXIT
wait
python tools/draw_page.py
python -m tools.draw_guides
