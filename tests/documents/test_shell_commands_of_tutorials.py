"""Every file, command and output of the start pages and tutorials is as described."""

import pytest
from reader import of, type_page


@pytest.mark.timeout(600)
@pytest.mark.parametrize("page", of("tutorials"))
def test_a_page_can_be_followed(page, tmp_path, island):
    type_page(page, tmp_path, island)
