"""Texts of any origin in XML."""

import re
from typing import Final
from xml.sax.saxutils import escape

# Characters that XML 1.0 does not allow, not even escaped.
_UNWRITABLE: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def xml_characters(text: str) -> str:
    """The text with U+FFFD in place of characters that XML does not allow."""
    return _UNWRITABLE.sub("\ufffd", text)


def xml_text(text: str) -> str:
    """Any text as XML character data."""
    return escape(xml_characters(text))
