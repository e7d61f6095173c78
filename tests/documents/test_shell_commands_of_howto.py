"""Every file, command and output of the how-to guides is as described."""

import pytest
from reader import of, type_page


@pytest.mark.timeout(600)
@pytest.mark.parametrize("page", of("howto"))
def test_a_page_can_be_followed(page, tmp_path, island):
    type_page(page, tmp_path, island)
