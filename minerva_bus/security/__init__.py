"""Security of remote members: rights, credentials and certificates (docs/security.md).

The rights of a certificate are in security/credentials.py, the keys of the bus that they open in
security/access.py. Who may send which events is a matter of each frame: frame/sender_rights.py.
"""
