"""The robot of the paper: its maps, and how it finds its way on them."""
