"""A bridge to agents of SPADE, and any others that speak FIPA ACL over XMPP."""

from minerva_services.bridges.spade.service import Spade

__all__ = ["Spade"]
