"""Security of worlds with remote members: rights, credentials, certificates (docs/security.md)."""
