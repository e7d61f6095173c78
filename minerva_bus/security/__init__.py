"""Who may take part in a world: rights, credentials, certificates. See docs/security.md."""
