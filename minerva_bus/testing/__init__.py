"""Tools to test worlds, agents and services; part of the public interface."""
