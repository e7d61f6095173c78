"""The models in Mesa 3, written as Mesa's documentation recommends."""
