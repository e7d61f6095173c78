"""Models of the NetLogo library as worlds, written from their published descriptions."""
