"""Zenoh: sessions, members and the coordinator. The only package that imports zenoh."""
