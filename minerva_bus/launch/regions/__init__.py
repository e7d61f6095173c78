"""Runs a world as regions: settings, member processes, journals, and terms that all share."""
