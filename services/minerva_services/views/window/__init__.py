"""What views in a window have in common, whatever they draw with: `sprites`, `opengl`.

A view derives from `WindowDevice` and gives it a `Painter`, its geometric system G. The device
does the rest: it joins, opens a window (or writes PNG files, or a video), lists what is to be
drawn, looks at keyboard and mouse, sends people's orders, and asks the world how it is doing.

    class Sprites(WindowDevice, draws=("ePicture",)):
        def __init__(self, width: int = 1200, path: str = "", ...) -> None:
            super().__init__(Showing("sprites", width=width, path=path, ...))

        def painter(self) -> Painter:
            from minerva_services.views.sprites.painter import SpritePainter  # needs the extra
            return SpritePainter()

- `showing`: the options of a view, checked, and whether it is a window, pictures or a video.
- `painter`: the protocol `Painter`, and `Sight`, all that it draws of one moment.
- `device`: `WindowDevice`.
- `picking`: what is under the mouse: the nearest disc of an agent, or a label.
- `roles`: which of the world's event types a click, two clicks and the arrow keys send.
- `hands`: from clicks and keys to deeds; `deeds`: what is done to the world, and told.
- `watch`: a thread that does the deeds and asks for the status, so that no window waits.
- `keys`: which key does what; the help is made of it.
- `screen`: pygame's display, or one line that says why there is none.
- `pictures`: PNG files; `video`: MP4 and GIF files.

Only `screen`, `pictures`, `video` and `events` need a library, which they import when used.
"""

from minerva_services.views.window.device import WindowDevice
from minerva_services.views.window.painter import Beams, Box, Painter, Sight
from minerva_services.views.window.showing import Medium, Showing

__all__ = ["Beams", "Box", "Medium", "Painter", "Showing", "Sight", "WindowDevice"]
