"""A page in the browser that is a member: it draws the world, and may host agents."""

from minerva_services.views.page.service import MemberPage

__all__ = ["MemberPage"]
