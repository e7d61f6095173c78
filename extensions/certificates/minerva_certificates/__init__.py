"""A certificate authority for the members of a world.

issuing    the authority and its folder: certificates, their rights, revocations
command    `minerva keys`
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_certificates.issuing import AuthorityFolder, Wanted

__getattr__ = imported_at_first_use(__name__, {"issuing": "AuthorityFolder Wanted"})

__all__ = ["AuthorityFolder", "Wanted"]
