"""For authors of worlds and services: templates of packages, and checks of what they have written.

scaffold      `new`: a package from a template, or a copy of an installed world
world_schema  `schema`: the JSON Schema of world files, for editors
determinism   `determinism`: runs of a world in two layouts of processes, compared
"""
