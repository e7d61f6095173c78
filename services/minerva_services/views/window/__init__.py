"""Common parts of views in windows, independent of how they draw: `sprites`, `opengl`.

A view derives from `WindowDevice` and provides a `Painter`, its geometric system G. The device does
the rest: it joins, opens a window (or writes PNG files, or a video), composes what is displayed,
processes keyboard and mouse, sends users' orders, and polls the world's status.

    class Sprites(WindowDevice, draws=("ePicture",)):
        service = "sprites"

        def painter(self) -> Painter:
            from minerva_services.views.sprites.painter import SpritePainter  # needs the extra
            return SpritePainter()

- `options`: the options of a view, validated; they select a window, pictures or a video.
- `painter`: the protocol `Painter`, and `Sight`, everything that it displays at one time.
- `device`: `WindowDevice`; `composer`: from views and scans to a `Sight`.
- `outputs`: PNG files and videos; `video`: MP4 and GIF files.
- `picking`: what is under the mouse: the nearest disc of an agent, or a label.
- `order_types`: which of the world's event types a click, two clicks and the arrow keys send.
- `controls`: key bindings, and from clicks and keys to actions; `actions`: changes to the world.
- `monitor`: a thread that performs actions and polls the status, so that no window blocks.
- `screen`: pygame's display, or an error that explains why there is none.

Only `screen`, `outputs`, `video` and `events` need a library, which they import when used.
"""

from minerva_services.views.window.device import WindowDevice
from minerva_services.views.window.options import Medium, WindowOptions
from minerva_services.views.window.painter import Beams, Box, Painter, Sight

__all__ = ["Beams", "Box", "Medium", "Painter", "Sight", "WindowDevice", "WindowOptions"]
