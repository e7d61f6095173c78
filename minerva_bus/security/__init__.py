"""Security of remote members: rights, credentials and certificates (docs/security.md)."""
