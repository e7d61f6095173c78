"""Every shell command of the main README and of deploy/ works as described."""

import pytest
from reader import of, type_page


@pytest.mark.timeout(600)
@pytest.mark.parametrize("page", of("others"))
def test_every_command_of_a_page_works(page, tmp_path, island):
    type_page(page, tmp_path, island)
