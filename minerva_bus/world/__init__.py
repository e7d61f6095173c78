"""Events, agents, evolution and views: equations 2 to 6.

    equation 2, λ                world/agent_evolution.py
    equation 3, η; its policies  world/evolution.py
    equations 4 and 5, θ and π   world/visualization.py
    equation 6, E(C*, t)         world/event_collection.py, the total order of events
    random streams               world/context.py
    bases of generators, views   world/services.py

Equation 1, φ, is in semantics/geometry.py. New views and sensors are outside the kernel: services/.
"""
