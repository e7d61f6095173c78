"""A bridge to SPADE agents and other agents that speak FIPA ACL over XMPP."""

from minerva_services.bridges.spade.service import Spade

__all__ = ["Spade"]
