"""Services of which another process takes the port between its choice and its use."""

import importlib
from dataclasses import replace

import pytest
from web_world import PCart, PStone, taken_port, yard

from minerva_bus import View
from minerva_services.geometry.picture import Discs
from minerva_services.views import page_access
from minerva_services.views.page_access import listen


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
    monkeypatch.setattr(page_access, "_is_free", lambda *address: True)
    with taken:
        made.joined(replace(yard(), endpoint="tcp/127.0.0.1:9"))
        made.close()
    assert f":{port}" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("package", "service", "library"),
    [("web", "Web", "viser"), ("foxglove", "Foxglove", "foxglove")],
)
def test_two_views_of_one_kind_have_their_own_ports_and_pictures(package, service, library, capsys):
    pytest.importorskip(library)
    made = getattr(importlib.import_module(f"minerva_services.views.{package}"), service)
    devices = {draws: made(draws=draws) for draws in ("ePicture", "eShade")}
    try:
        for device in devices.values():
            device.joined(yard())
        for draws, scene in (("ePicture", PCart()), ("eShade", PStone(0.3) + PStone(0.4))):
            devices[draws].show(View(1, draws, scene))
        discs = [sum(map(len, device._overlay.picture().of(Discs))) for device in devices.values()]
        assert discs == [1, 2]
    finally:
        for device in devices.values():
            device.close()
    addresses = capsys.readouterr().out.split()
    assert len({*addresses}) == len(addresses) == 2
