"""The models in Minerva Bus: spaces with compiled rules, one frame per step."""
