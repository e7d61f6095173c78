"""Services of which another process takes the port between its choice and its use."""

import importlib
from dataclasses import replace

import pytest
from web_world import taken_port, yard

from minerva_services.views import page_address
from minerva_services.views.page_address import listen


@pytest.mark.parametrize(
    ("package", "service", "library"),
    [
        ("web", "Web", "viser"),
        ("foxglove", "Foxglove", "foxglove"),
        ("page", "MemberPage", "websockets"),
    ],
)
def test_the_next_port_is_used(package, service, library, monkeypatch, capsys):
    pytest.importorskip(library)
    made = getattr(importlib.import_module(f"minerva_services.views.{package}"), service)()
    taken, port = taken_port()

    def listens(name, host, wanted, start, first=0):
        return listen(name, host, wanted, start, port)

    where = "serving" if package == "web" else "service"
    module = importlib.import_module(f"minerva_services.views.{package}.{where}")
    monkeypatch.setattr(module, "listen", listens)
    monkeypatch.setattr(page_address, "_is_free", lambda *address: True)
    with taken:
        made.joined(replace(yard(), endpoint="tcp/127.0.0.1:9"))
        made.close()
    assert f":{port}" not in capsys.readouterr().out
