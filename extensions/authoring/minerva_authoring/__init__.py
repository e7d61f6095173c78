"""For authors of worlds and services: templates of packages, and checks of worlds and of machines.

scaffold      `new`: a package from a template, or a copy of an installed world
world_schema  `schema`: the JSON Schema of world files, for editors
doctor        `doctor`: what this machine has of what worlds need
"""
