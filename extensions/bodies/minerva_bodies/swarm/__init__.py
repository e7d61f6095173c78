"""The world `swarm`: quadrotors fly formations, and a norm keeps them away from a tower."""
