"""For authors of worlds and services: templates of packages, and checks of worlds and of machines.

scaffold      `new`: a package from a template, or a copy of an installed world
world_schema  `schema`: the JSON Schema of world files, for editors
determinism   `determinism`: runs of a world in two layouts of processes, compared
doctor        `doctor`: what this machine has of what worlds need
"""
