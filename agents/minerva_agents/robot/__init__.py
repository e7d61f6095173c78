"""The paper's robot: agent, maps, planning and exploration."""
