"""A bridge to SPADE agents and other agents that speak FIPA ACL over XMPP."""

from minerva_messages.spade.service import Spade

__all__ = ["Spade"]
