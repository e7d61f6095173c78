"""Pictures of a world as SVG and PNG files, drawn from the forms of its vocabulary."""

from minerva_services.views.svg.service import Svg

__all__ = ["Svg"]
